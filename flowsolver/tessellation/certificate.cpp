#include "tessellation/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "geometry/corners.hpp"
#include "tessellation/predicates.hpp"

namespace poreslip {
namespace {

using geometry::block_size;
using geometry::Corners;

// What the filter has to say of a facet, in any mix.
enum : std::uint8_t { violated = 1, undecided = 2, left_doubtful = 4, right_doubtful = 8 };

// What double precision could not clear.
struct Findings {
  std::vector<std::size_t> violated, undecided;  // facets
  std::vector<std::int32_t> doubtful;            // cells that may be inside out, some several times
};

// The power test of facets whose five vertices are grains, and the orientation of the cells on both sides.
//
// With m the largest squared distance of the facet's other vertices from its first, a row of the determinants is at most sqrt(m) long, a
// lift at most m + 2 w, and the absolute values of a 3 x 3 determinant's terms sum to sqrt(3) m^1.5 at most. So one bound does for
// all errors; compared as squares it needs no root.
void filter_facets(const FacetArrays& facet, std::size_t begin, std::size_t end, const LocalGrains& grains, Findings& findings) {
  constexpr double minor_error = relative_error * relative_error * 3.0, power_error = 16.0 * minor_error;
  Corners<5> at;
  alignas(64) std::uint64_t verdict[block_size];
  Vertex apex[2][block_size];
  for (std::size_t first = begin; first < end; first += block_size) {
    const std::size_t count = std::min(block_size, end - first);
    const Vertex *va = facet.vertex[0].data() + first, *vd = facet.left_apex.data() + first,
                 *ve = facet.right_apex.data() + first;
    // A wall in place of an apex is for filter_walled; here the facet's own grain stands in for it.
    for (std::size_t f = 0; f < count; ++f) {
      apex[0][f] = vd[f] < 0 ? va[f] : vd[f];
      apex[1][f] = ve[f] < 0 ? va[f] : ve[f];
    }
    at.fetch({va, facet.vertex[1].data() + first, facet.vertex[2].data() + first, apex[0], apex[1]}, grains.packed.data(), 0,
             count);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
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
      const double cde = cx * de_yz + cy * de_zx + cz * de_xy, bde = bx * de_yz + by * de_zx + bz * de_xy;
      const double bce = bc_yz * ex + bc_zx * ey + bc_xy * ez, bcd = bc_yz * dx + bc_zx * dy + bc_xy * dz;
      const double det = (c2 - wc + wa) * bde - (b2 - wb + wa) * cde + (e2 - we + wa) * bcd - (d2 - wd + wa) * bce;
      const double m = std::max(std::max(b2, c2), std::max(d2, e2));
      const double lift = m + wa + std::max(std::max(wb, wc), std::max(wd, we));
      const double cubed = m * m * m, power_bound = power_error * cubed * lift * lift, minor_bound = minor_error * cubed;
      const bool certain = det * det > power_bound;
      verdict[f] = (certain ? (det > 0.0 ? violated : 0) : undecided) |
                   (bcd < 0.0 && bcd * bcd > minor_bound ? 0 : left_doubtful) |
                   (bce > 0.0 && bce * bce > minor_bound ? 0 : right_doubtful);
    }
    for (std::size_t f = 0; f < count; ++f) {
      if (verdict[f] == 0) continue;
      const bool walls = (vd[f] < 0) | (ve[f] < 0);
      if (verdict[f] & undecided || walls) findings.undecided.push_back(first + f);
      else if (verdict[f] & violated) findings.violated.push_back(first + f);
      if (verdict[f] & left_doubtful && vd[f] >= 0) findings.doubtful.push_back(facet.left[first + f]);
      if (verdict[f] & right_doubtful && ve[f] >= 0) findings.doubtful.push_back(facet.right[first + f]);
    }
  }
}

// The rows of a block of facets' determinants, in whose place a wall may be: as in Lifted.
struct Rows {
  double x[block_size], y[block_size], z[block_size];
  double per_radius[block_size];  // 0 for a grain
  double square[block_size], lift[block_size], scale[block_size];

  void set(const double (&at)[4][block_size], const double (&origin)[4][block_size], std::size_t count) {
    constexpr double sphere_error = 8.0 * 2.3e-16 / relative_error;
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const double dx = at[0][f] - origin[0][f], dy = at[1][f] - origin[1][f], dz = at[2][f] - origin[2][f], radius = at[3][f];
      const double weight = origin[3][f] * origin[3][f], sum = dx * dx + dy * dy + dz * dz;
      const bool wall = per_radius[f] > 0.0;
      // A wall's sphere is far off along its axis, and there alone.
      const double u = std::abs(dx), v = std::abs(dy), w = std::abs(dz), away = std::max(u, std::max(v, w)), gap = away - radius;
      const double sideways = (u < away ? u * u : 0.0) + (v < away ? v * v : 0.0) + (w < away ? w * w : 0.0);
      const double rest = (gap * gap + sideways + weight) * per_radius[f], factor = wall ? per_radius[f] : 1.0;
      x[f] = dx * factor;
      y[f] = dy * factor;
      z[f] = dz * factor;
      square[f] = sum * factor * factor;
      lift[f] = wall ? 2.0 * gap + rest : sum - radius * radius + weight;
      scale[f] = wall ? 2.0 * std::abs(gap) + rest + sphere_error * radius : sum + radius * radius + weight;
    }
  }
};

// The same as filter_facets for listed facets that may have walls, each row with a bound of its own. What stays undecided is left in the list.
void filter_walled(const FacetArrays& facet, const LocalGrains& grains, const WallSpheres& walls, std::vector<std::size_t>& list,
                   Findings& findings) {
  constexpr double minor_error = relative_error * relative_error * 3.0, power_error = 4.0 * minor_error;
  alignas(64) double at[4][block_size], origin[4][block_size];
  alignas(64) std::uint64_t verdict[block_size];
  Rows b, c, d, e;
  const auto fetch = [&](const std::vector<Vertex>& vertex, std::size_t first, std::size_t count, double (&to)[4][block_size], double* per_radius) {
    for (std::size_t f = 0; f < count; ++f) {
      const Vertex v = vertex[list[first + f]];
      const bool wall = is_wall(v);
      const PackedGrain p = wall ? PackedGrain{walls.centre[wall_of(v)][0], walls.centre[wall_of(v)][1], walls.centre[wall_of(v)][2], walls.radius}
                                 : grains.packed[v];
      to[0][f] = p.x;
      to[1][f] = p.y;
      to[2][f] = p.z;
      to[3][f] = p.radius;
      if (per_radius) per_radius[f] = wall ? 1.0 / walls.radius : 0.0;
    }
  };
  std::size_t left_over = 0;
  for (std::size_t first = 0; first < list.size(); first += block_size) {
    const std::size_t count = std::min(block_size, list.size() - first);
    fetch(facet.vertex[0], first, count, origin, nullptr);
    for (auto [rows, vertex] : {std::pair{&b, &facet.vertex[1]}, {&c, &facet.vertex[2]}, {&d, &facet.left_apex}, {&e, &facet.right_apex}}) {
      fetch(*vertex, first, count, at, rows->per_radius);
      rows->set(at, origin, count);
    }
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const double bc_x = b.y[f] * c.z[f] - b.z[f] * c.y[f], bc_y = b.z[f] * c.x[f] - b.x[f] * c.z[f], bc_z = b.x[f] * c.y[f] - b.y[f] * c.x[f];
      const double de_x = d.y[f] * e.z[f] - d.z[f] * e.y[f], de_y = d.z[f] * e.x[f] - d.x[f] * e.z[f], de_z = d.x[f] * e.y[f] - d.y[f] * e.x[f];
      const double cde = c.x[f] * de_x + c.y[f] * de_y + c.z[f] * de_z, bde = b.x[f] * de_x + b.y[f] * de_y + b.z[f] * de_z;
      const double bce = bc_x * e.x[f] + bc_y * e.y[f] + bc_z * e.z[f], bcd = bc_x * d.x[f] + bc_y * d.y[f] + bc_z * d.z[f];
      const double det = c.lift[f] * bde - b.lift[f] * cde + e.lift[f] * bcd - d.lift[f] * bce;
      const double bc = b.square[f] * c.square[f], de = d.square[f] * e.square[f];
      const double bound = de * (b.scale[f] * b.scale[f] * c.square[f] + c.scale[f] * c.scale[f] * b.square[f]) +
                           bc * (d.scale[f] * d.scale[f] * e.square[f] + e.scale[f] * e.scale[f] * d.square[f]);
      verdict[f] = (det * det > power_error * bound ? (det > 0.0 ? violated : 0) : undecided) |
                   (bcd < 0.0 && bcd * bcd > minor_error * bc * d.square[f] ? 0 : left_doubtful) |
                   (bce > 0.0 && bce * bce > minor_error * bc * e.square[f] ? 0 : right_doubtful);
    }
    for (std::size_t f = 0; f < count; ++f) {
      const std::size_t number = list[first + f];
      if (facet.right[number] < 0) continue;
      if (verdict[f] & undecided) list[left_over++] = number;
      else if (verdict[f] & violated) findings.violated.push_back(number);
      if (verdict[f] & left_doubtful) findings.doubtful.push_back(facet.left[number]);
      if (verdict[f] & right_doubtful) findings.doubtful.push_back(facet.right[number]);
    }
  }
  list.resize(left_over);
}

}  // namespace

Certificate certify(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls) {
  Certificate certificate;
  const FacetArrays& facet = mesh.facet;
  std::vector<std::int32_t> cells;
  // Facets [begin, end), of which those up to middle have no walls.
  const auto test = [&](std::size_t begin, std::size_t middle, std::size_t end) {
    Findings found;
    filter_facets(facet, begin, middle, grains, found);
    for (std::size_t f = middle; f < end; ++f) found.undecided.push_back(f);
    filter_walled(facet, grains, walls, found.undecided, found);
    for (const std::size_t f : found.undecided) {
      if (violation_sign(grains, walls, {facet.vertex[0][f], facet.vertex[1][f], facet.vertex[2][f]}, facet.left_apex[f],
                         facet.right_apex[f], certificate.exact_tests) > 0)
        found.violated.push_back(f);
    }
    certificate.violated_facets.insert(certificate.violated_facets.end(), found.violated.begin(), found.violated.end());
    cells.insert(cells.end(), found.doubtful.begin(), found.doubtful.end());
  };
  test(0, facet.end[0], facet.end[2]);
  certificate.violated = static_cast<std::int64_t>(certificate.violated_facets.size());
  test(facet.end[2], facet.end[3], facet.end[4]);

  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  for (const std::int32_t c : cells) {
    if (orientation_sign(grains, walls, mesh.vertices(c), certificate.exact_tests) > 0) continue;
    if (static_cast<std::size_t>(c) < mesh.cells()) ++certificate.inverted_cells;
    else certificate.inverted_around.push_back(c);
  }
  return certificate;
}

}  // namespace poreslip
