#include "tessellation/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/corners.hpp"
#include "tessellation/predicates.hpp"

namespace poreslip {
namespace {

using geometry::block_size;
using geometry::Corners;

// Facets whose five vertices are grains. Undecided and violated ones are listed.
void filter_grain_facets(const Mesh& mesh, const LocalGrains& grains, std::vector<std::size_t>& undecided,
                         std::vector<std::size_t>& violated) {
  Corners<5> at;
  signed char verdict[block_size];
  Vertex apex[2][block_size];
  const FacetArrays& facet = mesh.facet;
  for (std::size_t first = 0; first < facet.end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, facet.end[0] - first);
    const Vertex *va = facet.vertex[0].data() + first, *vd = facet.left_apex.data() + first,
                 *ve = facet.right_apex.data() + first;
    // A wall in place of an apex is decided elsewhere; here the facet's own grain stands in for it.
    for (std::size_t f = 0; f < count; ++f) {
      apex[0][f] = vd[f] < 0 ? va[f] : vd[f];
      apex[1][f] = ve[f] < 0 ? va[f] : ve[f];
    }
    at.fetch({va, facet.vertex[1].data() + first, facet.vertex[2].data() + first, apex[0], apex[1]}, grains.packed.data(), 0,
             count);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const bool walls = (vd[f] < 0) | (ve[f] < 0);
      const double ax = at.x[0][f], ay = at.y[0][f], az = at.z[0][f], wa = at.r[0][f] * at.r[0][f];
      const double bx = at.x[1][f] - ax, by = at.y[1][f] - ay, bz = at.z[1][f] - az, b2 = bx * bx + by * by + bz * bz;
      const double cx = at.x[2][f] - ax, cy = at.y[2][f] - ay, cz = at.z[2][f] - az, c2 = cx * cx + cy * cy + cz * cz;
      const double dx = at.x[3][f] - ax, dy = at.y[3][f] - ay, dz = at.z[3][f] - az, d2 = dx * dx + dy * dy + dz * dz;
      const double ex = at.x[4][f] - ax, ey = at.y[4][f] - ay, ez = at.z[4][f] - az, e2 = ex * ex + ey * ey + ez * ez;
      const double wb = at.r[1][f] * at.r[1][f], wc = at.r[2][f] * at.r[2][f], wd = at.r[3][f] * at.r[3][f],
                   we = at.r[4][f] * at.r[4][f];
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
  Corners<4> at;
  signed char verdict[block_size];
  std::int64_t inverted = 0;
  for (std::size_t first = 0; first < mesh.cell_end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, mesh.cell_end[0] - first);
    at.fetch(mesh.cell_view().vertex, grains.packed.data(), first, count);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const double ax = at.x[0][f], ay = at.y[0][f], az = at.z[0][f];
      const double bx = at.x[1][f] - ax, by = at.y[1][f] - ay, bz = at.z[1][f] - az;
      const double cx = at.x[2][f] - ax, cy = at.y[2][f] - ay, cz = at.z[2][f] - az;
      const double dx = at.x[3][f] - ax, dy = at.y[3][f] - ay, dz = at.z[3][f] - az;
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
