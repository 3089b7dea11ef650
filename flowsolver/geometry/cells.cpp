#include "geometry/cells.hpp"

#include "geometry/corners.hpp"
#include "geometry/walls.hpp"

namespace poreslip::geometry {
namespace {

// Integral over s in [0, 1] of the product of two gaps that vary linearly along the edge of a wedge.
double mean_product(double a1, double a2, double b1, double b2) {
  return (a1 * a2 + b1 * b2) / 3.0 + (a1 * b2 + a2 * b1) / 6.0;
}

struct Wedge {
  Vector3 along;   // n1 x n2
  double length;   // extent of the edge along it, m
  double a1, a2;   // gaps of the first grain to the two walls, m
  double b1, b2;   // gaps of the second, m
};

Wedge wedge(const CellView& cells, const GrainView& grains, std::size_t c) {
  const Vertex i = cells.vertex[0][c], j = cells.vertex[1][c];
  const int w1 = wall_of(cells.vertex[2][c]), w2 = wall_of(cells.vertex[3][c]);
  const Vector3 along = cross(wall_normal(cells.vertex[2][c]), wall_normal(cells.vertex[3][c]));
  return {along, dot(grains.position(j) - grains.position(i), along),
          grains.gap(i, w1), grains.gap(i, w2), grains.gap(j, w1), grains.gap(j, w2)};
}

// Twice the area of a prism's triangle as its wall sees it, m^2.
double prism_projection(const CellView& cells, const GrainView& grains, std::size_t c) {
  const Vertex i = cells.vertex[0][c];
  return dot(cross(direction(grains, i, cells.vertex[1][c]), direction(grains, i, cells.vertex[2][c])),
             wall_normal(cells.vertex[3][c]));
}

// Calls visit(cell, grain, wall, dV/dgap) for every gap of every cell; gradients in m^2.
template <class Visit>
void for_each_gap_gradient(const CellView& cells, const GrainView& grains, Visit visit) {
  for (std::size_t c = cells.end[0]; c < cells.end[1]; ++c) {
    const double third = prism_projection(cells, grains, c) / 6.0;
    for (int k = 0; k < 3; ++k) visit(c, cells.vertex[k][c], cells.vertex[3][c], third);
  }
  for (std::size_t c = cells.end[1]; c < cells.end[2]; ++c) {
    const Wedge w = wedge(cells, grains, c);
    const Vertex i = cells.vertex[0][c], j = cells.vertex[1][c], w1 = cells.vertex[2][c], w2 = cells.vertex[3][c];
    visit(c, i, w1, w.length * (w.a2 / 3.0 + w.b2 / 6.0));
    visit(c, j, w1, w.length * (w.b2 / 3.0 + w.a2 / 6.0));
    visit(c, i, w2, w.length * (w.a1 / 3.0 + w.b1 / 6.0));
    visit(c, j, w2, w.length * (w.b1 / 3.0 + w.a1 / 6.0));
  }
  for (std::size_t c = cells.end[2]; c < cells.end[3]; ++c) {
    const Vertex i = cells.vertex[0][c];
    for (int k = 1; k < 4; ++k) {
      double area = 1.0;
      for (int o = 1; o < 4; ++o)
        if (o != k) area *= grains.gap(i, wall_of(cells.vertex[o][c]));
      visit(c, i, cells.vertex[k][c], area);
    }
  }
}

}  // namespace

void wall_cell_volumes(const CellView& cells, const GrainView& grains, int walls, double* volume) {
  for (std::size_t c = cells.end[0]; walls < 2 && c < cells.end[1]; ++c) {
    const int wall = wall_of(cells.vertex[3][c]);
    double gaps = 0.0;
    for (int k = 0; k < 3; ++k) gaps += grains.gap(cells.vertex[k][c], wall);
    volume[c] = prism_projection(cells, grains, c) * gaps / 6.0;
  }
  for (std::size_t c = cells.end[1]; c < cells.end[2]; ++c) {
    const Wedge w = wedge(cells, grains, c);
    volume[c] = w.length * mean_product(w.a1, w.a2, w.b1, w.b2);
  }
  for (std::size_t c = cells.end[2]; c < cells.end[3]; ++c) {
    volume[c] = 1.0;
    for (int k = 1; k < 4; ++k) volume[c] *= grains.gap(cells.vertex[0][c], wall_of(cells.vertex[k][c]));
  }
}

void cell_volumes(const CellView& cells, const GrainView& grains, double* volume) {
  Corners<4> at;
  for (std::size_t first = 0; first < cells.end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, cells.end[0] - first);
    at.fetch(cells.vertex, grains.packed, first, count);
#pragma omp simd
    for (std::size_t c = 0; c < count; ++c) {
      const double ax = at.x[1][c] - at.x[0][c], ay = at.y[1][c] - at.y[0][c], az = at.z[1][c] - at.z[0][c];
      const double bx = at.x[2][c] - at.x[0][c], by = at.y[2][c] - at.y[0][c], bz = at.z[2][c] - at.z[0][c];
      const double cx = at.x[3][c] - at.x[0][c], cy = at.y[3][c] - at.y[0][c], cz = at.z[3][c] - at.z[0][c];
      volume[first + c] = (ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)) / 6.0;
    }
  }
  wall_cell_volumes(cells, grains, 1, volume);
}

Vector3 cell_centroid(const CellView& cells, const GrainView& grains, std::size_t c) {
  Vertex v[4];
  for (int k = 0; k < 4; ++k) v[k] = cells.vertex[k][c];
  if (c < cells.end[0])
    return 0.25 * ((grains.position(v[0]) + grains.position(v[1])) + (grains.position(v[2]) + grains.position(v[3])));
  if (c < cells.end[1]) {
    // Columns of linearly varying height over the triangle.
    double g[3], sum = 0.0, squares = 0.0;
    for (int k = 0; k < 3; ++k) {
      g[k] = grains.gap(v[k], wall_of(v[3]));
      sum += g[k];
      squares += g[k] * g[k];
    }
    Vector3 p = ((squares + sum * sum) / (8.0 * sum)) * wall_normal(v[3]);
    for (int k = 0; k < 3; ++k) p = p + ((g[k] + sum) / (4.0 * sum)) * grains.position(v[k]);
    return p;
  }
  if (c < cells.end[2]) {
    const Wedge w = wedge(cells, grains, c);
    const double area = mean_product(w.a1, w.a2, w.b1, w.b2);
    const double s = ((w.a1 * w.a2 + w.a1 * w.b2 + w.a2 * w.b1) / 12.0 + w.b1 * w.b2 / 4.0) / area;
    // Integral of g1^2 g2 over the edge.
    const auto moment = [](double a1, double b1, double a2, double b2) {
      return (a1 * a1 * a2 + b1 * b1 * b2) / 4.0 +
             (2.0 * a1 * b1 * a2 + a1 * a1 * b2 + b1 * b1 * a2 + 2.0 * a1 * b1 * b2) / 12.0;
    };
    return (1.0 - s) * grains.position(v[0]) + s * grains.position(v[1]) +
           (0.5 * moment(w.a1, w.b1, w.a2, w.b2) / area) * wall_normal(v[2]) +
           (0.5 * moment(w.a2, w.b2, w.a1, w.b1) / area) * wall_normal(v[3]);
  }
  Vector3 p = grains.position(v[0]);
  for (int k = 1; k < 4; ++k) p = p + (0.5 * grains.gap(v[0], wall_of(v[k]))) * wall_normal(v[k]);
  return p;
}

void cell_centroids(const CellView& cells, const GrainView& grains, double* centre) {
  // A row at a time, of four with the radius; the next one's takes the fourth's place.
  using Four [[gnu::vector_size(32)]] = double;
  using UnalignedFour [[gnu::vector_size(32), gnu::aligned(8), gnu::may_alias]] = double;
  const auto mean = [&](std::size_t c) {
    const auto grain = [&](int k) { return reinterpret_cast<const UnalignedFour&>(grains.packed[cells.vertex[k][c]]); };
    return Four(0.25 * ((grain(0) + grain(1)) + (grain(2) + grain(3))));
  };
  for (std::size_t c = 0; c + 1 < cells.end[0]; ++c) reinterpret_cast<UnalignedFour&>(centre[3 * c]) = mean(c);
  if (const std::size_t c = cells.end[0]; c > 0) {
    const Four last = mean(c - 1);
    for (int d = 0; d < 3; ++d) centre[3 * (c - 1) + d] = last[d];
  }
  for (std::size_t c = cells.end[0]; c < cells.size(); ++c) {
    const Vector3 p = cell_centroid(cells, grains, c);
    for (int d = 0; d < 3; ++d) centre[3 * c + d] = p[d];
  }
}

void add_wall_forces(const CellView& cells, const GrainView& grains, const bool* counted, const double* pressure,
                     double* force) {
  for_each_gap_gradient(cells, grains, [&](std::size_t c, Vertex grain, Vertex wall, double gradient) {
    if (counted[c]) force[6 * grains.group[grain] + wall_of(wall)] += pressure[c] * gradient;
  });
}

void add_wall_forces_of_gradient(const CellView& cells, const GrainView& grains, const bool* counted, const double* centre,
                                 const Vector3& gradient, double* force) {
  for_each_gap_gradient(cells, grains, [&](std::size_t c, Vertex grain, Vertex wall, double area) {
    // Weighted with these areas, the grains' places along the wall have their mean in the roof's centroid.
    const Vector3 from_centre = grains.position(grain) - Vector3{centre[3 * c], centre[3 * c + 1], centre[3 * c + 2]};
    if (counted[c]) force[6 * grains.group[grain] + wall_of(wall)] += area * dot(gradient, from_centre);
  });
}

void add_wall_volume_rates(const CellView& cells, const GrainView& grains, const double* wall_velocity, double* rate) {
  for_each_gap_gradient(cells, grains, [&](std::size_t c, Vertex grain, Vertex wall, double gradient) {
    rate[c] += gradient * wall_velocity[6 * grains.group[grain] + wall_of(wall)];
  });
}

void for_each_roof(const CellView& cells, const GrainView& grains, const std::function<void(std::size_t, std::size_t, double)>& visit) {
  for_each_gap_gradient(cells, grains, [&](std::size_t c, Vertex grain, Vertex wall, double gradient) {
    visit(c, 6 * static_cast<std::size_t>(grains.group[grain]) + wall_of(wall), gradient);
  });
}

Vector3 cell_volume_gradient(const CellView& cells, const GrainView& grains, std::size_t c, int k) {
  Vertex v[4];
  for (int o = 0; o < 4; ++o) v[o] = cells.vertex[o][c];
  if (c < cells.end[0]) {
    // A third of the opposite face's area, pointing inwards.
    static constexpr int opposite[4][3] = {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}};
    const int* f = opposite[k];
    return (1.0 / 6.0) * cross(direction(grains, v[f[0]], v[f[1]]), direction(grains, v[f[0]], v[f[2]]));
  }
  if (c < cells.end[1]) {
    const Vector3 n = wall_normal(v[3]);
    double gaps = 0.0;
    for (int o = 0; o < 3; ++o) gaps += grains.gap(v[o], wall_of(v[3]));
    const Vector3 opposite = grains.position(v[(k + 1) % 3]) - grains.position(v[(k + 2) % 3]);
    return (gaps / 6.0) * cross(opposite, n) - (prism_projection(cells, grains, c) / 6.0) * n;
  }
  if (c < cells.end[2]) {
    const Wedge w = wedge(cells, grains, c);
    const double sign = k == 0 ? -1.0 : 1.0;
    const double own1 = k == 0 ? w.a1 : w.b1, own2 = k == 0 ? w.a2 : w.b2;
    const double other1 = k == 0 ? w.b1 : w.a1, other2 = k == 0 ? w.b2 : w.a2;
    return (sign * mean_product(w.a1, w.a2, w.b1, w.b2)) * w.along -
           (w.length * (own2 / 3.0 + other2 / 6.0)) * wall_normal(v[2]) -
           (w.length * (own1 / 3.0 + other1 / 6.0)) * wall_normal(v[3]);
  }
  Vector3 gradient{0.0, 0.0, 0.0};
  for (int o = 1; o < 4; ++o) {
    double area = 1.0;
    for (int q = 1; q < 4; ++q)
      if (q != o) area *= grains.gap(v[0], wall_of(v[q]));
    gradient = gradient - area * wall_normal(v[o]);
  }
  return gradient;
}

}  // namespace poreslip::geometry
