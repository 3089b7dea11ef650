#include "tessellation/certificate.hpp"

#include <cmath>
#include <vector>

namespace poreslip {
namespace {

// Relative rounding error of a determinant below, of the sum of its terms' absolute values: some twenty operations each.
constexpr double relative_error = 1e-14;

// A vertex seen from a grain: direction, and how far it is lifted, |d|^2 - (R^2 - R_a^2). For a wall both over its sphere's
// radius, which keeps all signs.
struct Lifted {
  double d[3];
  double lift;
  double lift_scale;   // sum of the absolute values of the lift's terms
  double lift_error;   // error beyond rounding: the sphere's own coordinates carry fewer digits of the plane
};

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

// Facets whose five vertices are grains, four or eight at a time. Undecided ones are listed; violated ones are counted.
std::int64_t filter_grain_facets(const Mesh& mesh, const LocalGrains& grains, std::vector<std::size_t>& undecided) {
  const double *x = grains.x.data(), *y = grains.y.data(), *z = grains.z.data(), *r = grains.radius.data();
  constexpr std::size_t block = 256;
  signed char verdict[block];
  std::int64_t violated = 0;
  for (std::size_t first = 0; first < mesh.facet.end[0]; first += block) {
    const std::size_t count = std::min(block, mesh.facet.end[0] - first);
    const Vertex *va = mesh.facet.vertex[0].data() + first, *vb = mesh.facet.vertex[1].data() + first,
                 *vc = mesh.facet.vertex[2].data() + first, *vd = mesh.facet.left_apex.data() + first,
                 *ve = mesh.facet.right_apex.data() + first;
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const Vertex a = va[f], b = vb[f], c = vc[f];
      const bool walls = (vd[f] < 0) | (ve[f] < 0);
      const Vertex d = vd[f] < 0 ? a : vd[f], e = ve[f] < 0 ? a : ve[f];
      const double wa = r[a] * r[a];
      const double bx = x[b] - x[a], by = y[b] - y[a], bz = z[b] - z[a], b2 = bx * bx + by * by + bz * bz, wb = r[b] * r[b];
      const double cx = x[c] - x[a], cy = y[c] - y[a], cz = z[c] - z[a], c2 = cx * cx + cy * cy + cz * cz, wc = r[c] * r[c];
      const double dx = x[d] - x[a], dy = y[d] - y[a], dz = z[d] - z[a], d2 = dx * dx + dy * dy + dz * dz, wd = r[d] * r[d];
      const double ex = x[e] - x[a], ey = y[e] - y[a], ez = z[e] - z[a], e2 = ex * ex + ey * ey + ez * ez, we = r[e] * r[e];
      // 2 x 2 minors of (b, c) and (d, e), and Laplace's expansion of the 4 x 4 determinant by pairs of rows.
      const double bc_xy = bx * cy - by * cx, bc_yz = by * cz - bz * cy, bc_zx = bz * cx - bx * cz;
      const double de_xy = dx * ey - dy * ex, de_yz = dy * ez - dz * ey, de_zx = dz * ex - dx * ez;
      const double lb = b2 - wb + wa, lc = c2 - wc + wa, ld = d2 - wd + wa, le = e2 - we + wa;
      const double cde = cx * de_yz + cy * de_zx + cz * de_xy, bde = bx * de_yz + by * de_zx + bz * de_xy;
      const double bce = bc_yz * ex + bc_zx * ey + bc_xy * ez, bcd = bc_yz * dx + bc_zx * dy + bc_xy * dz;
      const double det = -lb * cde + lc * bde - ld * bce + le * bcd;
      const double sbc_xy = std::abs(bx * cy) + std::abs(by * cx), sbc_yz = std::abs(by * cz) + std::abs(bz * cy),
                   sbc_zx = std::abs(bz * cx) + std::abs(bx * cz);
      const double sde_xy = std::abs(dx * ey) + std::abs(dy * ex), sde_yz = std::abs(dy * ez) + std::abs(dz * ey),
                   sde_zx = std::abs(dz * ex) + std::abs(dx * ez);
      const double error =
          relative_error *
          ((b2 + wb + wa) * (std::abs(cx) * sde_yz + std::abs(cy) * sde_zx + std::abs(cz) * sde_xy) +
           (c2 + wc + wa) * (std::abs(bx) * sde_yz + std::abs(by) * sde_zx + std::abs(bz) * sde_xy) +
           (d2 + wd + wa) * (sbc_yz * std::abs(ex) + sbc_zx * std::abs(ey) + sbc_xy * std::abs(ez)) +
           (e2 + we + wa) * (sbc_yz * std::abs(dx) + sbc_zx * std::abs(dy) + sbc_xy * std::abs(dz)));
      verdict[f] = walls | (std::abs(det) <= error) ? 0 : (det > 0.0 ? 1 : -1);
    }
    for (std::size_t f = 0; f < count; ++f) {
      violated += verdict[f] > 0;
      if (verdict[f] == 0) undecided.push_back(first + f);
    }
  }
  return violated;
}

// Tetrahedra of grains; undecided ones are listed, inverted ones counted.
std::int64_t filter_tetrahedra(const Mesh& mesh, const LocalGrains& grains, std::vector<std::size_t>& undecided) {
  const double *x = grains.x.data(), *y = grains.y.data(), *z = grains.z.data();
  constexpr std::size_t block = 256;
  signed char verdict[block];
  std::int64_t inverted = 0;
  for (std::size_t first = 0; first < mesh.cell_end[0]; first += block) {
    const std::size_t count = std::min(block, mesh.cell_end[0] - first);
    const Vertex *va = mesh.cell_vertex[0].data() + first, *vb = mesh.cell_vertex[1].data() + first,
                 *vc = mesh.cell_vertex[2].data() + first, *vd = mesh.cell_vertex[3].data() + first;
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const Vertex a = va[f], b = vb[f], c = vc[f], d = vd[f];
      const double bx = x[b] - x[a], by = y[b] - y[a], bz = z[b] - z[a];
      const double cx = x[c] - x[a], cy = y[c] - y[a], cz = z[c] - z[a];
      const double dx = x[d] - x[a], dy = y[d] - y[a], dz = z[d] - z[a];
      const double det = bx * (cy * dz - cz * dy) + by * (cz * dx - cx * dz) + bz * (cx * dy - cy * dx);
      const double scale = std::abs(bx) * (std::abs(cy * dz) + std::abs(cz * dy)) +
                           std::abs(by) * (std::abs(cz * dx) + std::abs(cx * dz)) +
                           std::abs(bz) * (std::abs(cx * dy) + std::abs(cy * dx));
      verdict[f] = std::abs(det) <= relative_error * scale ? 0 : (det > 0.0 ? 1 : -1);
    }
    for (std::size_t f = 0; f < count; ++f) {
      inverted += verdict[f] < 0;
      if (verdict[f] == 0) undecided.push_back(first + f);
    }
  }
  return inverted;
}

}  // namespace

Certificate certify(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls) {
  Certificate certificate;
  std::vector<std::size_t> cells, facets;
  certificate.inverted_cells = filter_tetrahedra(mesh, grains, cells);
  for (std::size_t c = mesh.cell_end[0]; c < mesh.cells(); ++c) cells.push_back(c);
  for (const std::size_t c : cells) {
    const std::array<Vertex, 4> v{mesh.cell_vertex[0][c], mesh.cell_vertex[1][c], mesh.cell_vertex[2][c],
                                  mesh.cell_vertex[3][c]};
    int sign = filtered_orientation(lifted(grains, walls, v[0], v[1]), lifted(grains, walls, v[0], v[2]),
                                    lifted(grains, walls, v[0], v[3]));
    if (sign == 0) {
      ++certificate.exact_tests;
      sign = exact_orientation(grains, walls, v);
    }
    certificate.inverted_cells += sign <= 0;
  }
  certificate.violated_facets = filter_grain_facets(mesh, grains, facets);
  for (std::size_t f = mesh.facet.end[0]; f < mesh.facets(); ++f) facets.push_back(f);
  for (const std::size_t f : facets) {
    const Vertex a = mesh.facet.vertex[0][f], b = mesh.facet.vertex[1][f], c = mesh.facet.vertex[2][f];
    const Vertex d = mesh.facet.left_apex[f], e = mesh.facet.right_apex[f];
    int sign = filtered_power({lifted(grains, walls, a, b), lifted(grains, walls, a, c), lifted(grains, walls, a, d),
                               lifted(grains, walls, a, e)});
    if (sign == 0) {
      ++certificate.exact_tests;
      sign = exact_power_side(grains, walls, {a, c, b, d}, e);
    }
    certificate.violated_facets += sign > 0;
  }
  return certificate;
}

}  // namespace poreslip
