#include "geometry/facets.hpp"

#include <numbers>

#include "geometry/angle.hpp"
#include "geometry/facet_blocks.hpp"
#include "geometry/walls.hpp"

namespace poreslip::geometry {
namespace {

inline double cube(double r) { return r * r * r; }

// Tangent of half the angle between two edges, from |a x b|, |a||b| and a.b.
inline double half_tangent(double cross_norm, double lengths, double product) {
  return cross_norm / (lengths + product);
}

// S_k of a facet's grains over the length of its normal, which is not one: area2 of a triangle, the width of a strip.
struct Shares {
  double a, b, c;
};

// S_k of a triangle. The integral of a vertex' barycentric coordinate over a neighbour's circular sector of angle theta is
// R^3 tan(theta / 2) / (3 l), with l the edge between the two: the sectors' own areas cancel, and no angle is needed.
// An overlap's frozen lens adds its first moment about the edge times the coordinates' slope away from the edge.
// Three divisions do for all: reciprocals come by threes from the reciprocal of a product.
inline Shares triangle_total(double area2, double ab2, double ac2, double bc2, double ab_ac, double ra, double rb, double rc) {
  const double ba_bc = ab2 - ab_ac, ca_cb = ac2 - ab_ac;
  const double lab = std::sqrt(ab2), lac = std::sqrt(ac2), lbc = std::sqrt(bc2);
  const double per_area = 1.0 / area2, per_lengths = 1.0 / (lab * lac * lbc);
  const double iab = lac * lbc * per_lengths, iac = lab * lbc * per_lengths, ibc = lab * lac * per_lengths;
  const double da = lab * lac + ab_ac, db = lab * lbc + ba_bc, dc = lac * lbc + ca_cb;
  const double per_angles = area2 / (da * db * dc);
  const double qa = cube(ra) * per_angles * db * dc, qb = cube(rb) * per_angles * da * dc, qc = cube(rc) * per_angles * da * db;
  constexpr double third = 1.0 / 3.0;
  const double ab = (qa - qb) * third * iab, ac = (qa - qc) * third * iac, bc = (qb - qc) * third * ibc;
  // Lens moment over the height of the opposite vertex above the edge.
  const double mab = lens_moment(ra, rb, lab, iab) * lab * per_area;
  const double mac = lens_moment(ra, rc, lac, iac) * lac * per_area;
  const double mbc = lens_moment(rb, rc, lbc, ibc) * lbc * per_area;
  // Foot of that height along the edge, from its first end, as a fraction.
  const double tab = ab_ac * iab * iab, tac = ab_ac * iac * iac, tbc = ba_bc * ibc * ibc;
  const double sixth = area2 / 6.0;
  return {per_area * (sixth + ab + ac - mab * (1.0 - tab) - mac * (1.0 - tac) + mbc),
          per_area * (sixth - ab + bc - mab * tab - mbc * (1.0 - tbc) + mac),
          per_area * (sixth - ac - bc - mac * tac - mbc * tbc + mab)};
}

inline Shares triangle_pressure(double area2, double ab2, double ac2, double ab_ac, double ra, double rb, double rc) {
  const double half = 0.5 / area2;
  return {half * ra * ra * angle(area2, ab_ac), half * rb * rb * angle(area2, ab2 - ab_ac), half * rc * rc * angle(area2, ac2 - ab_ac)};
}

using UnalignedFour [[gnu::vector_size(32), gnu::aligned(8), gnu::may_alias]] = double;

// Four columns of three, turned into four rows; their last component is 0.
inline std::array<Four, 4> rows_of(const double* x, const double* y, const double* z) {
  const Four a = reinterpret_cast<const UnalignedFour&>(*x), b = reinterpret_cast<const UnalignedFour&>(*y),
             c = reinterpret_cast<const UnalignedFour&>(*z), none{};
  const Four ab_even = __builtin_shufflevector(a, b, 0, 4, 2, 6), ab_odd = __builtin_shufflevector(a, b, 1, 5, 3, 7);
  const Four c_even = __builtin_shufflevector(c, none, 0, 4, 2, 6), c_odd = __builtin_shufflevector(c, none, 1, 5, 3, 7);
  return {__builtin_shufflevector(ab_even, c_even, 0, 1, 4, 5), __builtin_shufflevector(ab_odd, c_odd, 0, 1, 4, 5),
          __builtin_shufflevector(ab_even, c_even, 2, 3, 6, 7), __builtin_shufflevector(ab_odd, c_odd, 2, 3, 6, 7)};
}

// The differences of values left and right of facets. Built by fours: compilers would gather, which processors do slowly.
inline void differences(const double* value, const std::int32_t* left, const std::int32_t* right, std::size_t count, double* difference) {
  const auto four = [value](const std::int32_t* c) { return Four{value[c[0]], value[c[1]], value[c[2]], value[c[3]]}; };
  std::size_t f = 0;
  for (; f + 4 <= count; f += 4) reinterpret_cast<UnalignedFour&>(difference[f]) = four(left + f) - four(right + f);
  for (; f < count; ++f) difference[f] = value[left[f]] - value[right[f]];
}

// Whether there is a difference at all: given pressures are even over large parts of a pack, whose facets pass nothing on.
inline bool any_difference(const double* difference, std::size_t count) {
  double largest = 0.0;
#pragma omp simd reduction(max : largest)
  for (std::size_t f = 0; f < count; ++f) largest = std::max(largest, std::abs(difference[f]));
  return largest > 0.0;
}

template <ForceLaw law>
void add_triangle_forces(const FacetView& facets, const GrainView& grains, const double* pressure, Four* force) {
  alignas(64) double share[3][block_size], normal[3][block_size], difference[block_size];
  Corners<3> at;
  for (std::size_t first = 0, count, next; first < facets.end[0]; first = next) {
    count = std::min(block_size, facets.end[0] - first);
    next = first + count;
    const std::size_t after = std::min(next + block_size, facets.end[0]);
    const Vertex *va = facets.vertex[0] + first, *vb = facets.vertex[1] + first, *vc = facets.vertex[2] + first;
    differences(pressure, facets.left + first, facets.right + first, count, difference);
    // Those on the left come one after the other; of those on the right the next block's are asked for now.
    for (std::size_t f = next; f < after; ++f) __builtin_prefetch(pressure + facets.right[f]);
    if (!any_difference(difference, count)) continue;
    at.fetch(facets.vertex, grains.packed, first, count);
    Corners<3>::ask(facets.vertex, grains.packed, next, after);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const Triangle t = triangle(at, f);
      const double ra = at.r[0][f], rb = at.r[1][f], rc = at.r[2][f];
      const Shares s = law == ForceLaw::total ? triangle_total(t.area2, t.ab2, t.ac2, t.bc2, t.ab_ac, ra, rb, rc)
                                              : triangle_pressure(t.area2, t.ab2, t.ac2, t.ab_ac, ra, rb, rc);
      share[0][f] = s.a * difference[f];
      share[1][f] = s.b * difference[f];
      share[2][f] = s.c * difference[f];
      normal[0][f] = t.nx;
      normal[1][f] = t.ny;
      normal[2][f] = t.nz;
    }
    const auto add = [&](std::size_t f, const Four& n) {
      force[va[f]] += share[0][f] * n;
      force[vb[f]] += share[1][f] * n;
      force[vc[f]] += share[2][f] * n;
    };
    std::size_t f = 0;
    for (; f + 4 <= count; f += 4) {
      const std::array<Four, 4> n = rows_of(&normal[0][f], &normal[1][f], &normal[2][f]);
      for (std::size_t i = 0; i < 4; ++i) add(f + i, n[i]);
    }
    for (; f < count; ++f) add(f, Four{normal[0][f], normal[1][f], normal[2][f], 0.0});
  }
}

template <ForceLaw law>
inline Shares strip_shares(const Strip& s, double ri, double rj) {
  const double ti = half_tangent(s.width, s.edge, s.rise), tj = half_tangent(s.width, s.edge, -s.rise);
  const double per_width = 1.0 / s.width, half = 0.5 * per_width;
  if (law == ForceLaw::pressure) return {half * ri * ri * angle(s.width, s.rise), half * rj * rj * angle(s.width, -s.rise), 0.0};
  // As for a triangle whose third vertex is infinitely far: the coordinates are those along the projected edge.
  const double exchange = (cube(ri) * ti - cube(rj) * tj) / (3.0 * s.edge) +
                          (lens_over_two_pi(ri, rj, s.edge) * s.rise / s.edge + 0.5 * cap_over_pi(rj, s.gap_j) -
                           0.5 * cap_over_pi(ri, s.gap_i)) * per_width;
  return {(2.0 * s.gap_i + s.gap_j) / 6.0 + per_width * exchange, (s.gap_i + 2.0 * s.gap_j) / 6.0 - per_width * exchange, 0.0};
}

template <ForceLaw law>
void add_strip_forces(const FacetView& facets, const GrainView& grains, const double* pressure, Four* force) {
  StripCorners at;
  alignas(64) double share[2][block_size], normal[3][block_size], difference[block_size];
  for (std::size_t first = facets.end[0]; first < facets.end[1]; first += block_size) {
    const std::size_t count = std::min(block_size, facets.end[1] - first);
    const Vertex *vi = facets.vertex[0] + first, *vj = facets.vertex[1] + first;
    differences(pressure, facets.left + first, facets.right + first, count, difference);
    if (!any_difference(difference, count)) continue;
    at.fetch(facets, grains, first, count);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const Strip s = strip(at, f);
      const Shares shares = strip_shares<law>(s, at.radius[0][f], at.radius[1][f]);
      share[0][f] = shares.a * difference[f];
      share[1][f] = shares.b * difference[f];
      normal[0][f] = s.nx;
      normal[1][f] = s.ny;
      normal[2][f] = s.nz;
    }
    for (std::size_t f = 0; f < count; ++f) {
      const Four n{normal[0][f], normal[1][f], normal[2][f], 0.0};
      force[vi[f]] += share[0][f] * n;
      force[vj[f]] += share[1][f] * n;
    }
  }
}

// One strip.
Strip strip(const FacetView& facets, const GrainView& grains, std::size_t f) {
  StripCorners at;
  at.fetch(facets, grains, f, 1);
  return strip(at, 0);
}

}  // namespace

FacetShares facet_shares(const FacetView& facets, const GrainView& grains, std::size_t f, ForceLaw law) {
  const Vertex a = facets.vertex[0][f], b = facets.vertex[1][f], c = facets.vertex[2][f];
  if (f < facets.end[0]) {
    const Vector3 ab = grains.position(b) - grains.position(a), ac = grains.position(c) - grains.position(a);
    const Vector3 n = cross(ab, ac), bc = ac - ab;
    const double area2 = norm(n), ra = grains.radius[a], rb = grains.radius[b], rc = grains.radius[c];
    const Shares s = law == ForceLaw::total ? triangle_total(area2, dot(ab, ab), dot(ac, ac), dot(bc, bc), dot(ab, ac), ra, rb, rc)
                                            : triangle_pressure(area2, dot(ab, ab), dot(ac, ac), dot(ab, ac), ra, rb, rc);
    return {{area2 * s.a, area2 * s.b, area2 * s.c}, (1.0 / area2) * n};
  }
  if (f < facets.end[1]) {
    const Strip s = strip(facets, grains, f);
    const double ra = grains.radius[a], rb = grains.radius[b];
    const Shares shares = law == ForceLaw::total ? strip_shares<ForceLaw::total>(s, ra, rb) : strip_shares<ForceLaw::pressure>(s, ra, rb);
    return {{s.width * shares.a, s.width * shares.b, 0.0}, (1.0 / s.width) * Vector3{s.nx, s.ny, s.nz}};
  }
  const Vector3 n = cross(wall_normal(b), wall_normal(c));
  const double sector = 0.25 * std::numbers::pi * grains.radius[a] * grains.radius[a];
  const double area = grains.gap(a, wall_of(b)) * grains.gap(a, wall_of(c));
  return {{law == ForceLaw::total ? area : sector, 0.0, 0.0}, n};
}

std::array<double, 3> facet_area_shares(const FacetView& facets, const GrainView& grains, std::size_t f) {
  const Vertex a = facets.vertex[0][f], b = facets.vertex[1][f], c = facets.vertex[2][f];
  if (f < facets.end[0]) {
    const double third =
        norm(cross(grains.position(b) - grains.position(a), grains.position(c) - grains.position(a))) / 6.0;
    return {third, third, third};
  }
  if (f < facets.end[1]) {
    const Strip s = strip(facets, grains, f);
    return {s.width * (2.0 * s.gap_i + s.gap_j) / 6.0, s.width * (s.gap_i + 2.0 * s.gap_j) / 6.0, 0.0};
  }
  return {grains.gap(a, wall_of(b)) * grains.gap(a, wall_of(c)), 0.0, 0.0};
}

void add_facet_forces(const FacetView& facets, const GrainView& grains, const double* pressure, ForceLaw law, Four* force) {
  if (law == ForceLaw::total) {
    add_triangle_forces<ForceLaw::total>(facets, grains, pressure, force);
    add_strip_forces<ForceLaw::total>(facets, grains, pressure, force);
  } else {
    add_triangle_forces<ForceLaw::pressure>(facets, grains, pressure, force);
    add_strip_forces<ForceLaw::pressure>(facets, grains, pressure, force);
  }
  for (std::size_t f = facets.end[1]; f < facets.size(); ++f) {
    const FacetShares s = facet_shares(facets, grains, f, law);
    const double difference = pressure[facets.left[f]] - pressure[facets.right[f]];
    force[facets.vertex[0][f]] += difference * s.share[0] * Four{s.normal[0], s.normal[1], s.normal[2], 0.0};
  }
}

void add_volume_rates(const FacetView& facets, const GrainView& grains, const double* vx, const double* vy,
                      const double* vz, double* rate) {
    const auto [va, vb, vc] = facets.vertex;
  alignas(64) double swept[block_size];
  const auto hand_over = [&](std::size_t f, double volume) {
    rate[facets.left[f]] += volume;
    if (facets.right[f] >= 0) rate[facets.right[f]] -= volume;
  };
  for_each_triangle_block(facets, grains, [&](const Corners<3>& at, std::size_t first, std::size_t count) {
#pragma omp simd
    for (std::size_t i = 0; i < count; ++i) {
      const Vertex a = va[first + i], b = vb[first + i], c = vc[first + i];
      const Triangle t = triangle(at, i);
      const Shares s = triangle_total(t.area2, t.ab2, t.ac2, t.bc2, t.ab_ac, at.r[0][i], at.r[1][i], at.r[2][i]);
      swept[i] = s.a * (t.nx * vx[a] + t.ny * vy[a] + t.nz * vz[a]) + s.b * (t.nx * vx[b] + t.ny * vy[b] + t.nz * vz[b]) +
                 s.c * (t.nx * vx[c] + t.ny * vy[c] + t.nz * vz[c]);
    }
    for (std::size_t i = 0; i < count; ++i) hand_over(first + i, swept[i]);
  });
  for (std::size_t f = facets.end[0]; f < facets.size(); ++f) {
    const FacetShares s = facet_shares(facets, grains, f, ForceLaw::total);
    double volume = 0.0;
    for (int k = 0; k < (f < facets.end[1] ? 2 : 1); ++k) {
      const Vertex g = facets.vertex[k][f];
      volume += s.share[k] * (s.normal[0] * vx[g] + s.normal[1] * vy[g] + s.normal[2] * vz[g]);
    }
    hand_over(f, volume);
  }
}

void add_triangle_gradients(const FacetView& facets, const GrainView& grains, const TriangleCorners* corner, double* gradient) {
  alignas(64) double part[3][3][block_size];  // grain, component
  for_each_triangle_block(facets, grains, [&](const Corners<3>& at, std::size_t first, std::size_t count) {
#pragma omp simd
    for (std::size_t i = 0; i < count; ++i) {
      const Triangle t = triangle(at, i);
      const Shares s = triangle_total(t.area2, t.ab2, t.ac2, t.bc2, t.ab_ac, at.r[0][i], at.r[1][i], at.r[2][i]);
      part[0][0][i] = s.a * t.nx, part[0][1][i] = s.a * t.ny, part[0][2][i] = s.a * t.nz;
      part[1][0][i] = s.b * t.nx, part[1][1][i] = s.b * t.ny, part[1][2][i] = s.b * t.nz;
      part[2][0][i] = s.c * t.nx, part[2][1][i] = s.c * t.ny, part[2][2][i] = s.c * t.nz;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t f = first + i;
      const auto to = [gradient](std::int32_t cell, std::uint8_t k) -> UnalignedFour& {
        return reinterpret_cast<UnalignedFour&>(gradient[16 * static_cast<std::size_t>(cell) + 4 * k]);
      };
      for (int k = 0; k < 3; ++k) {
        const Four g{part[k][0][i], part[k][1][i], part[k][2][i], 0.0};
        to(facets.left[f], corner[f].left[k]) += g;
        if (facets.right[f] >= 0) to(facets.right[f], corner[f].right[k]) -= g;
      }
    }
  });
}

}  // namespace poreslip::geometry
