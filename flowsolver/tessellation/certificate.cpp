#include "tessellation/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "tessellation/predicates.hpp"

namespace poreslip {
namespace {

// Facets whose five vertices are grains, four or eight at a time. Undecided and violated ones are listed.
void filter_grain_facets(const Mesh& mesh, const LocalGrains& grains, std::vector<std::size_t>& undecided,
                         std::vector<std::size_t>& violated) {
  const double *x = grains.x.data(), *y = grains.y.data(), *z = grains.z.data(), *r = grains.radius.data();
  constexpr std::size_t block = 256;
  signed char verdict[block];
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
      if (verdict[f] > 0) violated.push_back(first + f);
      if (verdict[f] == 0) undecided.push_back(first + f);
    }
  }
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
    certificate.inverted_cells += orientation_sign(grains, walls, v, certificate.exact_tests) <= 0;
  }
  filter_grain_facets(mesh, grains, facets, certificate.violated_facets);
  for (std::size_t f = mesh.facet.end[0]; f < mesh.facets(); ++f) facets.push_back(f);
  for (const std::size_t f : facets) {
    const std::array<Vertex, 3> facet{mesh.facet.vertex[0][f], mesh.facet.vertex[1][f], mesh.facet.vertex[2][f]};
    if (violation_sign(grains, walls, facet, mesh.facet.left_apex[f], mesh.facet.right_apex[f], certificate.exact_tests) > 0)
      certificate.violated_facets.push_back(f);
  }
  return certificate;
}

}  // namespace poreslip
