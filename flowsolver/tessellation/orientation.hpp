// How the vertices of cells and facets are ordered: a cell is positively oriented, a facet's normal points out of its left cell.
#pragma once

#include <array>

#include "geometry/view.hpp"

namespace poreslip {

// Vertices of the facet opposite vertex k of a positively oriented cell, turning so that its normal points out of the cell.
constexpr int outward_facet[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

// The same facet with grains before walls; a rotation keeps the normal.
constexpr std::array<Vertex, 3> grains_first(std::array<Vertex, 3> f) {
  while (is_wall(f[0]) || (is_wall(f[1]) && !is_wall(f[2]))) f = {f[1], f[2], f[0]};
  return f;
}

constexpr int count_walls(const Vertex* v, int count) {
  int walls = 0;
  for (int k = 0; k < count; ++k) walls += is_wall(v[k]);
  return walls;
}

}  // namespace poreslip
