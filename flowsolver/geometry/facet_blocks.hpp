// Blocks of facets side by side, as the vectorised kernels see them.
#pragma once

#include <cmath>

#include "geometry/corners.hpp"
#include "geometry/view.hpp"

namespace poreslip::geometry {

// A triangle: twice its vector area, that one's length, the edges' squares, and the product of two edges.
struct Triangle {
  double nx, ny, nz, area2, ab2, ac2, bc2, ab_ac;
};

inline Triangle triangle(const Corners<3>& at, std::size_t i) {
  const double abx = at.x[1][i] - at.x[0][i], aby = at.y[1][i] - at.y[0][i], abz = at.z[1][i] - at.z[0][i];
  const double acx = at.x[2][i] - at.x[0][i], acy = at.y[2][i] - at.y[0][i], acz = at.z[2][i] - at.z[0][i];
  const double bcx = at.x[2][i] - at.x[1][i], bcy = at.y[2][i] - at.y[1][i], bcz = at.z[2][i] - at.z[1][i];
  const double nx = aby * acz - abz * acy, ny = abz * acx - abx * acz, nz = abx * acy - aby * acx;
  const double ab2 = abx * abx + aby * aby + abz * abz, ac2 = acx * acx + acy * acy + acz * acz, bc2 = bcx * bcx + bcy * bcy + bcz * bcz;
  return {nx, ny, nz, std::sqrt(nx * nx + ny * ny + nz * nz), ab2, ac2, bc2, abx * acx + aby * acy + abz * acz};
}

// Calls visit(corners, first, count) for blocks of the triangles.
template <class Visit>
void for_each_triangle_block(const FacetView& facets, const GrainView& grains, Visit visit) {
  Corners<3> corners;
  for (std::size_t first = 0; first < facets.end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, facets.end[0] - first);
    corners.fetch(facets.vertex, grains.packed, first, count);
    for (const Vertex* vertex : facets.vertex) ask_ahead(vertex, first);
    visit(corners, first, count);
  }
}

// Edges between two grains, each with its projection on a wall: strips.
struct StripCorners {
  alignas(64) double edge[3][block_size], towards[3][block_size];  // from the first grain to the second, and to the wall
  alignas(64) double radius[2][block_size], gap[2][block_size];

  void fetch(const FacetView& facets, const GrainView& grains, std::size_t first, std::size_t count) {
    for (std::size_t f = 0; f < count; ++f) {
      const Vertex vi = facets.vertex[0][first + f], vj = facets.vertex[1][first + f];
      const PackedGrain &i = grains.packed[vi], &j = grains.packed[vj];
      const int wall = wall_of(facets.vertex[2][first + f]);
      edge[0][f] = j.x - i.x;
      edge[1][f] = j.y - i.y;
      edge[2][f] = j.z - i.z;
      for (int d = 0; d < 3; ++d) towards[d][f] = d == wall_axis(wall) ? wall_sign(wall) : 0.0;
      radius[0][f] = i.radius;
      radius[1][f] = j.radius;
      gap[0][f] = grains.gap(vi, wall);
      gap[1][f] = grains.gap(vj, wall);
    }
  }
};

// A strip: its normal, `width` long, and lengths.
struct Strip {
  double nx, ny, nz;
  double width;       // of the edge as the wall sees it, m
  double edge;        // its own, m
  double rise;        // its component towards the wall, m
  double gap_i, gap_j;
};

inline Strip strip(const StripCorners& at, std::size_t f) {
  const double ex = at.edge[0][f], ey = at.edge[1][f], ez = at.edge[2][f];
  const double tx = at.towards[0][f], ty = at.towards[1][f], tz = at.towards[2][f];
  const double nx = ey * tz - ez * ty, ny = ez * tx - ex * tz, nz = ex * ty - ey * tx;
  return {nx, ny, nz, std::sqrt(nx * nx + ny * ny + nz * nz), std::sqrt(ex * ex + ey * ey + ez * ez), ex * tx + ey * ty + ez * tz,
          at.gap[0][f], at.gap[1][f]};
}

}  // namespace poreslip::geometry
