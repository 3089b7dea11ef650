// Regular triangulation (weighted Delaunay, weights R^2) of a rank's grains and the walls, and the exact predicates.
// The only part that uses CGAL.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "geometry/view.hpp"
#include "tessellation/domain.hpp"

namespace poreslip {

// The cells that touch a rank's own grains, and those around them.
struct LocalCells {
  std::vector<std::array<Vertex, 4>> vertex;              // positively oriented, grains before walls
  std::vector<std::array<std::int32_t, 4>> neighbour;     // across the facet opposite vertex k; -1: not among these
  // The first so many touch own grains. The others, of a rank with a halo, touch a grain of theirs; flips may need them, and they may be
  // wrong where they are not `complete`.
  std::size_t touching = 0;
  std::vector<std::int32_t> previous;                     // of the touching ones: the same cell of the mesh before, or -1; or empty
  bool complete = true;        // false: a grain beyond the known region could change a cell; fetch a wider halo
  std::int64_t hidden = 0;     // own grains that have no cell: they lie inside others
  std::string coincident;      // names a pair of own or known grains with the same centre, if there is one
};

// known_lower, known_upper: the region in which all grains are known. largest_radius: of all grains everywhere, m.
LocalCells triangulate(const LocalGrains& grains, const WallSpheres& walls, const std::array<double, 3>& known_lower,
                          const std::array<double, 3>& known_upper, double largest_radius);

// Exact signs on the same points the triangulation is made of.
// > 0 where the cell (a, b, c, d) is positively oriented.
int exact_orientation(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell);
// > 0 where e lies inside the orthosphere of the positively oriented cell: their common facet violates the power test.
int exact_power_side(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell, Vertex e);

}  // namespace poreslip
