#include "geometry/cells.hpp"

#include <numbers>

#include "geometry/angle.hpp"
#include "geometry/corners.hpp"

namespace poreslip::geometry {
namespace {

Vector3 wall_normal(Vertex v) {
  Vector3 n{0.0, 0.0, 0.0};
  n[wall_axis(wall_of(v))] = wall_sign(wall_of(v));
  return n;
}

// Direction from grain a to vertex b: to a grain, the difference of centres; to a wall, its outward normal.
Vector3 direction(const GrainView& grains, Vertex a, Vertex b) {
  return is_wall(b) ? wall_normal(b) : grains.position(b) - grains.position(a);
}

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

// Solid angle at the apex of three directions (Van Oosterom & Strackee 1983), by its half's tangent.
inline double solid_angle(double determinant, double la, double lb, double lc, double ab, double bc, double ca) {
  return 2.0 * angle(determinant, la * lb * lc + ab * lc + bc * la + ca * lb);
}

inline double sphere_sector(double radius, double angle) { return angle * radius * radius * radius / 3.0; }

// What the grains take of a cell that has walls, term by term, m^3.
double solid_in_wall_cell(const CellView& cells, const GrainView& grains, std::size_t c, int grain_count) {
  Vertex v[4];
  for (int k = 0; k < 4; ++k) v[k] = cells.vertex[k][c];
  double solid = 0.0;
  for (int k = 0; k < grain_count; ++k) {
    Vector3 d[3];
    int m = 0;
    for (int o = 0; o < 4; ++o)
      if (o != k) d[m++] = direction(grains, v[k], v[o]);
    const double determinant = std::abs(dot(d[0], cross(d[1], d[2])));
    solid += sphere_sector(grains.radius[v[k]], solid_angle(determinant, norm(d[0]), norm(d[1]), norm(d[2]),
                                                            dot(d[0], d[1]), dot(d[1], d[2]), dot(d[2], d[0])));
    for (int o = k + 1; o < 4; ++o) {
      const double lens = is_wall(v[o])
                              ? 0.5 * cap_over_pi(grains.radius[v[k]], grains.gap(v[k], wall_of(v[o])))
                              : lens_over_two_pi(grains.radius[v[k]], grains.radius[v[o]],
                                                 norm(direction(grains, v[k], v[o])));
      if (lens == 0.0) continue;
      const Vector3 edge = direction(grains, v[k], v[o]);
      int p = 0;
      while (p == k || p == o) ++p;
      int q = p + 1;
      while (q == k || q == o) ++q;
      const Vector3 s = cross(edge, direction(grains, v[k], v[p])), t = cross(edge, direction(grains, v[k], v[q]));
      solid -= lens * angle(norm(cross(s, t)), dot(s, t));
    }
  }
  return solid;
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

// Volumes of the cells that have walls.
void wall_cell_volumes(const CellView& cells, const GrainView& grains, double* volume) {
  for (std::size_t c = cells.end[0]; c < cells.end[1]; ++c) {
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

// Calls visit(corners, first, count) for blocks of the tetrahedra.
template <class Visit>
void for_each_tetrahedron_block(const CellView& cells, const GrainView& grains, Visit visit) {
  Corners<4> corners;
  for (std::size_t first = 0; first < cells.end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, cells.end[0] - first);
    corners.fetch(cells.vertex, grains.packed, first, count);
    visit(corners, first, count);
  }
}

}  // namespace

void cell_volumes(const CellView& cells, const GrainView& grains, double* volume) {
  for_each_tetrahedron_block(cells, grains, [&](const Corners<4>& at, std::size_t first, std::size_t count) {
#pragma omp simd
    for (std::size_t c = 0; c < count; ++c) {
      const double ax = at.x[1][c] - at.x[0][c], ay = at.y[1][c] - at.y[0][c], az = at.z[1][c] - at.z[0][c];
      const double bx = at.x[2][c] - at.x[0][c], by = at.y[2][c] - at.y[0][c], bz = at.z[2][c] - at.z[0][c];
      const double cx = at.x[3][c] - at.x[0][c], cy = at.y[3][c] - at.y[0][c], cz = at.z[3][c] - at.z[0][c];
      volume[first + c] = (ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)) / 6.0;
    }
  });
  wall_cell_volumes(cells, grains, volume);
}

void pore_volumes(const CellView& cells, const GrainView& grains, double* cell, double* pore) {
  for_each_tetrahedron_block(cells, grains, [&](const Corners<4>& at, std::size_t first, std::size_t count) {
#pragma omp simd
    for (std::size_t c = 0; c < count; ++c) {
      // Edges a = ij, b = ik, c = il, d = jk, e = jl, f = kl, all pointing to the later vertex.
      const double ax = at.x[1][c] - at.x[0][c], ay = at.y[1][c] - at.y[0][c], az = at.z[1][c] - at.z[0][c];
      const double bx = at.x[2][c] - at.x[0][c], by = at.y[2][c] - at.y[0][c], bz = at.z[2][c] - at.z[0][c];
      const double cx = at.x[3][c] - at.x[0][c], cy = at.y[3][c] - at.y[0][c], cz = at.z[3][c] - at.z[0][c];
      const double dx = bx - ax, dy = by - ay, dz = bz - az, ex = cx - ax, ey = cy - ay, ez = cz - az;
      const double fx = cx - bx, fy = cy - by, fz = cz - bz;
      const double det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx);
      const double aa = ax * ax + ay * ay + az * az, bb = bx * bx + by * by + bz * bz, cc = cx * cx + cy * cy + cz * cz;
      const double dd = dx * dx + dy * dy + dz * dz, ee = ex * ex + ey * ey + ez * ez, ff = fx * fx + fy * fy + fz * fz;
      const double ab = ax * bx + ay * by + az * bz, ac = ax * cx + ay * cy + az * cz, bc = bx * cx + by * cy + bz * cz;
      const double ad = ax * dx + ay * dy + az * dz, ae = ax * ex + ay * ey + az * ez, de = dx * ex + dy * ey + dz * ez;
      const double bf = bx * fx + by * fy + bz * fz, df = dx * fx + dy * fy + dz * fz, bd = bx * dx + by * dy + bz * dz;
      const double la = std::sqrt(aa), lb = std::sqrt(bb), lc = std::sqrt(cc);
      const double ld = std::sqrt(dd), le = std::sqrt(ee), lf = std::sqrt(ff);
      // Dihedral angle at an edge e between directions p and q: tangent |e| det / ((e.e)(p.q) - (e.p)(e.q)). In a cell that is
      // inside out all parts are negative.
      const double va = angle(la * det, aa * bc - ab * ac), vb = angle(lb * det, bb * ac - ab * bc);
      const double vc = angle(lc * det, cc * ab - ac * bc), vd = angle(ld * det, ad * de - dd * ae);
      const double ve = angle(le * det, ae * de - ee * ad), vf = angle(lf * det, ff * bd - bf * df);
      // The solid angle at a vertex is the sum of its edges' dihedral angles less pi (Girard).
      const double pi = std::copysign(std::numbers::pi, det);
      const double ri = at.r[0][c], rj = at.r[1][c], rk = at.r[2][c], rl = at.r[3][c];
      const double sectors = sphere_sector(ri, va + vb + vc - pi) + sphere_sector(rj, va + vd + ve - pi) +
                             sphere_sector(rk, vb + vd + vf - pi) + sphere_sector(rl, vc + ve + vf - pi);
      const double per_abc = 1.0 / (la * lb * lc), per_def = 1.0 / (ld * le * lf);
      const double lenses =
          lens_moment(ri, rj, la, lb * lc * per_abc) * va + lens_moment(ri, rk, lb, la * lc * per_abc) * vb +
          lens_moment(ri, rl, lc, la * lb * per_abc) * vc + lens_moment(rj, rk, ld, le * lf * per_def) * vd +
          lens_moment(rj, rl, le, ld * lf * per_def) * ve + lens_moment(rk, rl, lf, ld * le * per_def) * vf;
      cell[first + c] = det / 6.0;
      pore[first + c] = det / 6.0 - (sectors - lenses);
    }
  });
  wall_cell_volumes(cells, grains, cell);
  for (int walls = 1; walls < 4; ++walls)
    for (std::size_t c = cells.end[walls - 1]; c < cells.end[walls]; ++c)
      pore[c] = cell[c] - std::copysign(1.0, cell[c]) * solid_in_wall_cell(cells, grains, c, 4 - walls);
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
  const auto store = [centre](std::size_t c, const Vector3& p) {
    for (int d = 0; d < 3; ++d) centre[3 * c + d] = p[d];
  };
  for (std::size_t c = cells.end[0]; c < cells.end[1]; ++c) {
    // Columns of linearly varying height over the triangle.
    const Vertex w = cells.vertex[3][c];
    double g[3], sum = 0.0, squares = 0.0;
    for (int k = 0; k < 3; ++k) {
      g[k] = grains.gap(cells.vertex[k][c], wall_of(w));
      sum += g[k];
      squares += g[k] * g[k];
    }
    Vector3 p = ((squares + sum * sum) / (8.0 * sum)) * wall_normal(w);
    for (int k = 0; k < 3; ++k) p = p + ((g[k] + sum) / (4.0 * sum)) * grains.position(cells.vertex[k][c]);
    store(c, p);
  }
  for (std::size_t c = cells.end[1]; c < cells.end[2]; ++c) {
    const Wedge w = wedge(cells, grains, c);
    const double area = mean_product(w.a1, w.a2, w.b1, w.b2);
    const double s = ((w.a1 * w.a2 + w.a1 * w.b2 + w.a2 * w.b1) / 12.0 + w.b1 * w.b2 / 4.0) / area;
    // Integral of g1^2 g2 over the edge.
    const auto moment = [](double a1, double b1, double a2, double b2) {
      return (a1 * a1 * a2 + b1 * b1 * b2) / 4.0 +
             (2.0 * a1 * b1 * a2 + a1 * a1 * b2 + b1 * b1 * a2 + 2.0 * a1 * b1 * b2) / 12.0;
    };
    store(c, (1.0 - s) * grains.position(cells.vertex[0][c]) + s * grains.position(cells.vertex[1][c]) +
                 (0.5 * moment(w.a1, w.b1, w.a2, w.b2) / area) * wall_normal(cells.vertex[2][c]) +
                 (0.5 * moment(w.a2, w.b2, w.a1, w.b1) / area) * wall_normal(cells.vertex[3][c]));
  }
  for (std::size_t c = cells.end[2]; c < cells.end[3]; ++c) {
    const Vertex i = cells.vertex[0][c];
    Vector3 p = grains.position(i);
    for (int k = 1; k < 4; ++k)
      p = p + (0.5 * grains.gap(i, wall_of(cells.vertex[k][c]))) * wall_normal(cells.vertex[k][c]);
    store(c, p);
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
