// What the geometry kernels read: structures of arrays of grains, cells and facets. They own nothing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace poreslip {

// A vertex of a cell is a grain (its index, >= 0) or one of six walls (-1 .. -6: x low, x high, y low, y high, z low, z high).
using Vertex = std::int32_t;

constexpr bool is_wall(Vertex v) { return v < 0; }
constexpr int wall_of(Vertex v) { return -1 - v; }
constexpr Vertex vertex_of_wall(int wall) { return -1 - wall; }
constexpr int wall_axis(int wall) { return wall / 2; }
// Outward direction of a wall along its axis: -1 for a low wall, +1 for a high one.
constexpr double wall_sign(int wall) { return wall % 2 == 0 ? -1.0 : 1.0; }

// A grain's centre and radius, m, in one half of a cache line.
struct alignas(32) PackedGrain {
  double x, y, z, radius;
};

// Grains, and the plane of each wall for each group of grains.
struct GrainView {
  const double* x;                // m
  const double* y;                // m
  const double* z;                // m
  const double* radius;           // m
  const PackedGrain* packed;      // the same once more, for the vectorised kernels
  const std::int32_t* group;      // row of wall_position
  const double* wall_position;    // (groups, 6), m, along each wall's own axis

  std::array<double, 3> position(Vertex v) const { return {packed[v].x, packed[v].y, packed[v].z}; }
  // Distance from a grain's centre to its own group's plane of a wall, > 0 inside, m.
  double gap(Vertex v, int wall) const {
    const PackedGrain& g = packed[v];
    const int axis = wall_axis(wall);
    return wall_sign(wall) * (wall_position[6 * group[v] + wall] - (axis == 0 ? g.x : axis == 1 ? g.y : g.z));
  }
};

// Cells, positively oriented, grains before walls, sorted by the number of walls:
// tetrahedra [0, end[0]), prisms (one wall) [end[0], end[1]), wedges (two), corners (three).
struct CellView {
  std::array<const Vertex*, 4> vertex;
  std::array<std::size_t, 4> end;
  std::size_t size() const { return end[3]; }
};

// Facets between two cells, grains before walls, sorted by the number of walls: triangles [0, end[0]), strips, rectangles.
// (a, b, c) turns so that the normal points out of the left cell.
struct FacetView {
  std::array<const Vertex*, 3> vertex;
  const std::int32_t* left;
  const std::int32_t* right;
  const Vertex* left_apex;   // the left cell's vertex off the facet
  const Vertex* right_apex;
  std::array<std::size_t, 3> end;
  std::size_t size() const { return end[2]; }
};

}  // namespace poreslip
