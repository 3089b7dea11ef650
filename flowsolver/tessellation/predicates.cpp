#include "tessellation/predicates.hpp"

namespace poreslip {

Lifted lifted(const LocalGrains& grains, const WallSpheres& walls, Vertex a, Vertex b) {
  Lifted r;
  const double pa[3] = {grains.x[a], grains.y[a], grains.z[a]};
  if (!is_wall(b)) {
    const double pb[3] = {grains.x[b], grains.y[b], grains.z[b]};
    double square = 0.0;
    for (int k = 0; k < 3; ++k) {
      r.d[k] = pb[k] - pa[k];
      square += r.d[k] * r.d[k];
    }
    const double wa = grains.radius[a] * grains.radius[a], wb = grains.radius[b] * grains.radius[b];
    r.lift = square - wb + wa;
    r.lift_scale = square + wb + wa;
    r.lift_error = 0.0;
    return r;
  }
  const int wall = wall_of(b), axis = wall_axis(wall);
  const double sign = wall_sign(wall), radius = walls.radius;
  double sideways = 0.0;
  for (int k = 0; k < 3; ++k) {
    const double d = walls.centre[wall][k] - pa[k];
    r.d[k] = d / radius;
    if (k != axis) sideways += d * d;
  }
  const double gap = sign * (walls.centre[wall][axis] - pa[axis]) - radius;
  const double rest = (gap * gap + sideways + grains.radius[a] * grains.radius[a]) / radius;
  r.lift = 2.0 * gap + rest;
  r.lift_scale = 2.0 * std::abs(gap) + rest;
  r.lift_error = 8.0 * 2.3e-16 * radius;
  return r;
}

namespace {

// Sign of the orientation of three directions: 1, -1, or 0 if rounding could change it.
int filtered_orientation(const Lifted& b, const Lifted& c, const Lifted& d) {
  double det = 0.0, scale = 0.0;
  for (int k = 0; k < 3; ++k) {
    const int p = (k + 1) % 3, q = (k + 2) % 3;
    det += b.d[k] * (c.d[p] * d.d[q] - c.d[q] * d.d[p]);
    scale += std::abs(b.d[k]) * (std::abs(c.d[p] * d.d[q]) + std::abs(c.d[q] * d.d[p]));
  }
  if (std::abs(det) <= relative_error * scale) return 0;
  return det > 0.0 ? 1 : -1;
}

// Sign of the lifted determinant of a facet (a, b, c), the left apex d and the right apex e: > 0 violated, < 0 regular,
// 0 undecided.
int filtered_power(const Lifted (&row)[4]) {
  double det = 0.0, error = 0.0;
  for (int i = 0; i < 4; ++i) {
    const Lifted& p = row[i == 0 ? 1 : 0];
    const Lifted& q = row[i <= 1 ? 2 : 1];
    const Lifted& s = row[i <= 2 ? 3 : 2];
    double minor = 0.0, scale = 0.0;
    for (int k = 0; k < 3; ++k) {
      const int u = (k + 1) % 3, v = (k + 2) % 3;
      minor += p.d[k] * (q.d[u] * s.d[v] - q.d[v] * s.d[u]);
      scale += std::abs(p.d[k]) * (std::abs(q.d[u] * s.d[v]) + std::abs(q.d[v] * s.d[u]));
    }
    det += (i % 2 == 0 ? -1.0 : 1.0) * row[i].lift * minor;
    error += (relative_error * row[i].lift_scale + row[i].lift_error) * scale;
  }
  if (std::abs(det) <= error) return 0;
  return det > 0.0 ? 1 : -1;
}

}  // namespace

int orientation_sign(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell,
                     std::int64_t& exact_tests) {
  const int sign = filtered_orientation(lifted(grains, walls, cell[0], cell[1]), lifted(grains, walls, cell[0], cell[2]),
                                        lifted(grains, walls, cell[0], cell[3]));
  if (sign != 0) return sign;
  ++exact_tests;
  return exact_orientation(grains, walls, cell);
}

int violation_sign(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 3>& facet, Vertex d, Vertex e,
                   std::int64_t& exact_tests) {
  const auto [a, b, c] = facet;
  const int sign = filtered_power({lifted(grains, walls, a, b), lifted(grains, walls, a, c), lifted(grains, walls, a, d),
                                   lifted(grains, walls, a, e)});
  if (sign != 0) return sign;
  ++exact_tests;
  return exact_power_side(grains, walls, {a, c, b, d}, e);
}

}  // namespace poreslip
