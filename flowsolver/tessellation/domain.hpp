// The box, its periods and its walls.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "geometry/view.hpp"

namespace poreslip {

// A box with a wall on both faces of each direction that is not periodic.
struct Domain {
  std::array<double, 3> lower, upper;  // m
  std::array<bool, 3> periodic;
  double length(int axis) const { return upper[axis] - lower[axis]; }
  bool has_wall(int wall) const { return !periodic[wall / 2]; }
};

// Spheres so large that they stand for the walls in the triangulation's combinatorics (geometry takes the exact limit).
struct WallSpheres {
  std::array<bool, 6> present;
  std::array<std::array<double, 3>, 6> centre;  // m
  std::array<double, 6> plane;                  // position along its axis for the triangulation, outermost over the groups, m
  double radius;                                // m, a power of two
};

WallSpheres make_wall_spheres(const Domain& domain, const std::vector<double>& wall_position);

// The grains a rank knows: its own and its halo, in Hilbert order.
struct LocalGrains {
  std::vector<double> x, y, z, radius;             // m
  std::vector<PackedGrain> packed;                 // the same once more, as the vectorised kernels read them
  std::vector<std::int64_t> id;
  std::vector<std::int32_t> group;
  std::vector<std::int32_t> source;                // >= 0: index among own grains; < 0: -1 - index in the halo
  std::vector<std::array<std::int8_t, 3>> shift;   // periods by which it is displaced from its owner's coordinates
  std::size_t size() const { return id.size(); }
  bool own(std::size_t i) const { return source[i] >= 0; }
};

}  // namespace poreslip
