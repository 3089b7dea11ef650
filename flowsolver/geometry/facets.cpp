#include "geometry/facets.hpp"

#include <numbers>

#include "geometry/angle.hpp"
#include "geometry/corners.hpp"

namespace poreslip::geometry {
namespace {

inline double cube(double r) { return r * r * r; }

// Tangent of half the angle between two edges, from |a x b|, |a||b| and a.b.
inline double half_tangent(double cross_norm, double lengths, double product) {
  return cross_norm / (lengths + product);
}

struct Shares {
  double a, b, c;
};

// S_k of a triangle. The integral of a vertex' barycentric coordinate over a neighbour's circular sector of angle theta is
// R^3 tan(theta / 2) / (3 l), with l the edge between the two: the sectors' own areas cancel, and no angle is needed.
// An overlap's frozen lens adds its first moment about the edge times the coordinates' slope away from the edge.
// Three divisions do for all: reciprocals come by threes from the reciprocal of a product.
inline Shares triangle_total(double area2, double lab, double lac, double lbc, double ab_ac, double ra, double rb,
                             double rc) {
  const double ba_bc = lab * lab - ab_ac, ca_cb = lac * lac - ab_ac;
  const double per_lengths = 1.0 / (lab * lac * lbc);
  const double iab = lac * lbc * per_lengths, iac = lab * lbc * per_lengths, ibc = lab * lac * per_lengths;
  const double da = lab * lac + ab_ac, db = lab * lbc + ba_bc, dc = lac * lbc + ca_cb;
  const double per_angles = area2 / (da * db * dc);
  const double qa = cube(ra) * per_angles * db * dc, qb = cube(rb) * per_angles * da * dc, qc = cube(rc) * per_angles * da * db;
  constexpr double third = 1.0 / 3.0;
  const double ab = (qa - qb) * third * iab, ac = (qa - qc) * third * iac, bc = (qb - qc) * third * ibc;
  // Lens moment over the height of the opposite vertex above the edge.
  const double per_area = 1.0 / area2;
  const double mab = lens_moment(ra, rb, lab, iab) * lab * per_area;
  const double mac = lens_moment(ra, rc, lac, iac) * lac * per_area;
  const double mbc = lens_moment(rb, rc, lbc, ibc) * lbc * per_area;
  // Foot of that height along the edge, from its first end, as a fraction.
  const double tab = ab_ac * iab * iab, tac = ab_ac * iac * iac, tbc = ba_bc * ibc * ibc;
  const double sixth = area2 / 6.0;
  return {sixth + ab + ac - mab * (1.0 - tab) - mac * (1.0 - tac) + mbc,
          sixth - ab + bc - mab * tab - mbc * (1.0 - tbc) + mac,
          sixth - ac - bc - mac * tac - mbc * tbc + mab};
}

inline Shares triangle_pressure(double area2, double lab, double lac, double ab_ac, double ra, double rb, double rc) {
  return {0.5 * ra * ra * angle(area2, ab_ac), 0.5 * rb * rb * angle(area2, lab * lab - ab_ac),
          0.5 * rc * rc * angle(area2, lac * lac - ab_ac)};
}

// A triangle as the kernels see it: twice its vector area, that one's length, and the edges' lengths.
struct Triangle {
  double nx, ny, nz, area2, lab, lac, lbc, ab_ac;
};

inline Triangle triangle(const Corners<3>& at, std::size_t i) {
  const double abx = at.x[1][i] - at.x[0][i], aby = at.y[1][i] - at.y[0][i], abz = at.z[1][i] - at.z[0][i];
  const double acx = at.x[2][i] - at.x[0][i], acy = at.y[2][i] - at.y[0][i], acz = at.z[2][i] - at.z[0][i];
  const double bcx = at.x[2][i] - at.x[1][i], bcy = at.y[2][i] - at.y[1][i], bcz = at.z[2][i] - at.z[1][i];
  const double nx = aby * acz - abz * acy, ny = abz * acx - abx * acz, nz = abx * acy - aby * acx;
  return {nx, ny, nz, std::sqrt(nx * nx + ny * ny + nz * nz), std::sqrt(abx * abx + aby * aby + abz * abz),
          std::sqrt(acx * acx + acy * acy + acz * acz), std::sqrt(bcx * bcx + bcy * bcy + bcz * bcz),
          abx * acx + aby * acy + abz * acz};
}

// Calls visit(corners, first, count) for blocks of the triangles.
template <class Visit>
void for_each_triangle_block(const FacetView& facets, const GrainView& grains, Visit visit) {
  Corners<3> corners;
  for (std::size_t first = 0; first < facets.end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, facets.end[0] - first);
    corners.fetch(facets.vertex, grains.packed, first, count);
    visit(corners, first, count);
  }
}

using Four [[gnu::vector_size(32)]] = double;
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

template <ForceLaw law>
void add_triangle_forces(const FacetView& facets, const GrainView& grains, const double* pressure, double* force) {
  alignas(64) double share[3][block_size], normal[3][block_size], difference[block_size];
  for_each_triangle_block(facets, grains, [&](const Corners<3>& at, std::size_t first, std::size_t count) {
    const Vertex *va = facets.vertex[0] + first, *vb = facets.vertex[1] + first, *vc = facets.vertex[2] + first;
    differences(pressure, facets.left + first, facets.right + first, count, difference);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const Triangle t = triangle(at, f);
      const double ra = at.r[0][f], rb = at.r[1][f], rc = at.r[2][f];
      const Shares s = law == ForceLaw::total ? triangle_total(t.area2, t.lab, t.lac, t.lbc, t.ab_ac, ra, rb, rc)
                                              : triangle_pressure(t.area2, t.lab, t.lac, t.ab_ac, ra, rb, rc);
      const double scale = difference[f] / t.area2;
      share[0][f] = s.a * scale;
      share[1][f] = s.b * scale;
      share[2][f] = s.c * scale;
      normal[0][f] = t.nx;
      normal[1][f] = t.ny;
      normal[2][f] = t.nz;
    }
    const auto add = [&](std::size_t f, const Four& n) {
      const auto to = [force](Vertex v) -> UnalignedFour& { return reinterpret_cast<UnalignedFour&>(force[4 * static_cast<std::size_t>(v)]); };
      to(va[f]) += share[0][f] * n;
      to(vb[f]) += share[1][f] * n;
      to(vc[f]) += share[2][f] * n;
    };
    std::size_t f = 0;
    for (; f + 4 <= count; f += 4) {
      const std::array<Four, 4> n = rows_of(&normal[0][f], &normal[1][f], &normal[2][f]);
      for (std::size_t i = 0; i < 4; ++i) add(f + i, n[i]);
    }
    for (; f < count; ++f) add(f, Four{normal[0][f], normal[1][f], normal[2][f], 0.0});
  });
}

Vector3 wall_normal(int wall) {
  Vector3 n{0.0, 0.0, 0.0};
  n[wall_axis(wall)] = wall_sign(wall);
  return n;
}

// A strip: an edge between two grains and its projection on a wall. Unit normal, lengths and gaps.
struct Strip {
  Vector3 normal;
  double width;       // length of the edge as the wall sees it, m
  double edge;        // its own length, m
  double rise;        // its component towards the wall, m
  double gap_i, gap_j;
};

Strip strip(const FacetView& facets, const GrainView& grains, std::size_t f) {
  const Vertex i = facets.vertex[0][f], j = facets.vertex[1][f];
  const int wall = wall_of(facets.vertex[2][f]);
  const Vector3 e = grains.position(j) - grains.position(i), n = wall_normal(wall), c = cross(e, n);
  const double width = norm(c);
  return {(1.0 / width) * c, width, norm(e), dot(e, n), grains.gap(i, wall), grains.gap(j, wall)};
}

template <ForceLaw law>
inline Shares strip_shares(const Strip& s, double ri, double rj) {
  const double ti = half_tangent(s.width, s.edge, s.rise), tj = half_tangent(s.width, s.edge, -s.rise);
  if (law == ForceLaw::pressure) return {0.5 * ri * ri * angle(s.width, s.rise), 0.5 * rj * rj * angle(s.width, -s.rise), 0.0};
  // As for a triangle whose third vertex is infinitely far: the coordinates are those along the projected edge.
  const double exchange = (cube(ri) * ti - cube(rj) * tj) / (3.0 * s.edge) +
                          (lens_over_two_pi(ri, rj, s.edge) * s.rise / s.edge + 0.5 * cap_over_pi(rj, s.gap_j) -
                           0.5 * cap_over_pi(ri, s.gap_i)) / s.width;
  return {s.width * (2.0 * s.gap_i + s.gap_j) / 6.0 + exchange, s.width * (s.gap_i + 2.0 * s.gap_j) / 6.0 - exchange, 0.0};
}

template <ForceLaw law>
void add_strip_forces(const FacetView& facets, const GrainView& grains, const double* pressure, double* force) {
  alignas(64) double edge[3][block_size], towards[3][block_size], radius[2][block_size], gap[2][block_size];
  alignas(64) double share[2][block_size], normal[3][block_size], difference[block_size];
  for (std::size_t first = facets.end[0]; first < facets.end[1]; first += block_size) {
    const std::size_t count = std::min(block_size, facets.end[1] - first);
    const Vertex *vi = facets.vertex[0] + first, *vj = facets.vertex[1] + first;
    for (std::size_t f = 0; f < count; ++f) {
      const PackedGrain &i = grains.packed[vi[f]], &j = grains.packed[vj[f]];
      const int wall = wall_of(facets.vertex[2][first + f]);
      edge[0][f] = j.x - i.x;
      edge[1][f] = j.y - i.y;
      edge[2][f] = j.z - i.z;
      for (int d = 0; d < 3; ++d) towards[d][f] = d == wall_axis(wall) ? wall_sign(wall) : 0.0;
      radius[0][f] = i.radius;
      radius[1][f] = j.radius;
      gap[0][f] = grains.gap(vi[f], wall);
      gap[1][f] = grains.gap(vj[f], wall);
    }
    differences(pressure, facets.left + first, facets.right + first, count, difference);
#pragma omp simd
    for (std::size_t f = 0; f < count; ++f) {
      const double ex = edge[0][f], ey = edge[1][f], ez = edge[2][f], nx = towards[0][f], ny = towards[1][f], nz = towards[2][f];
      const double cx = ey * nz - ez * ny, cy = ez * nx - ex * nz, cz = ex * ny - ey * nx, width = std::sqrt(cx * cx + cy * cy + cz * cz);
      const Strip s{{}, width, std::sqrt(ex * ex + ey * ey + ez * ez), ex * nx + ey * ny + ez * nz, gap[0][f], gap[1][f]};
      const Shares shares = strip_shares<law>(s, radius[0][f], radius[1][f]);
      const double scale = difference[f] / width;
      share[0][f] = shares.a * scale;
      share[1][f] = shares.b * scale;
      normal[0][f] = cx;
      normal[1][f] = cy;
      normal[2][f] = cz;
    }
    for (std::size_t f = 0; f < count; ++f) {
      const Four n{normal[0][f], normal[1][f], normal[2][f], 0.0};
      reinterpret_cast<UnalignedFour&>(force[4 * static_cast<std::size_t>(vi[f])]) += share[0][f] * n;
      reinterpret_cast<UnalignedFour&>(force[4 * static_cast<std::size_t>(vj[f])]) += share[1][f] * n;
    }
  }
}

// A chord at distance d from a disc's centre: half its length, half the angle of its arc, and half the area of the segment
// beyond it. All are zero where it misses the disc; beyond the far side the segment is the disc.
inline double half_chord(double radius, double d) { return std::sqrt(std::max((radius - d) * (radius + d), 0.0)); }
inline double arc_half_angle(double radius, double d) { return angle(half_chord(radius, d), d); }
inline double half_segment(double radius, double d) {
  return 0.5 * (radius * radius * arc_half_angle(radius, d) - d * half_chord(radius, d));
}
// Distance from the first centre to the radical plane of two spheres.
inline double radical_distance(double ra, double rb, double l) { return 0.5 * (l + (ra - rb) * (ra + rb) / l); }

// Half of an overlap's plane lens: its area goes back to the open area, and the arcs inside it leave the perimeter.
struct HalfLens {
  double area, arcs;
};
inline HalfLens half_lens(double ra, double rb, double l) {
  const double da = radical_distance(ra, rb, l), db = l - da;
  return {half_segment(ra, da) + half_segment(rb, db), ra * arc_half_angle(ra, da) + rb * arc_half_angle(rb, db)};
}
inline double open_gap(double length) { return std::max(length, 0.0); }

// The chord that two discs have in common: its distances from their centres along the line of these, and half its length,
// zero where they do not meet (or one lies within the other).
struct Chord {
  double near, far, half;
};
inline Chord chord(double ra, double rb, double l, double per_l) {
  const double near = 0.5 * (l + (ra - rb) * (ra + rb) * per_l);
  return {near, l - near, half_chord(ra, near)};
}

// What is left of a disc's angle in a triangle, given as a vector (x, y), between the chords on the two edges: each takes the
// angle of (distance, half length) off it. One angle of a product of complex numbers, not three.
inline double open_angle(double x, double y, double distance1, double half1, double distance2, double half2) {
  const double x1 = x * distance1 + y * half1, y1 = y * distance1 - x * half1;
  const double open = angle(y1 * distance2 - x1 * half2, x1 * distance2 + y1 * half2);
  // Where a chord lies beyond the centre, the three angles can come to less than -pi.
  const double most = std::max(distance1, distance2) < 0.0 ? 0.0 : 0.5 * std::numbers::pi;
  return open - (std::min(distance1, distance2) < 0.0 && open > most ? 2.0 * std::numbers::pi : 0.0);
}

}  // namespace

FacetShares facet_shares(const FacetView& facets, const GrainView& grains, std::size_t f, ForceLaw law) {
  const Vertex a = facets.vertex[0][f], b = facets.vertex[1][f], c = facets.vertex[2][f];
  if (f < facets.end[0]) {
    const Vector3 ab = grains.position(b) - grains.position(a), ac = grains.position(c) - grains.position(a);
    const Vector3 n = cross(ab, ac);
    const double area2 = norm(n), lbc = norm(ac - ab), ra = grains.radius[a], rb = grains.radius[b], rc = grains.radius[c];
    const Shares s = law == ForceLaw::total ? triangle_total(area2, norm(ab), norm(ac), lbc, dot(ab, ac), ra, rb, rc)
                                            : triangle_pressure(area2, norm(ab), norm(ac), dot(ab, ac), ra, rb, rc);
    return {{s.a, s.b, s.c}, (1.0 / area2) * n};
  }
  if (f < facets.end[1]) {
    const Strip s = strip(facets, grains, f);
    const double ra = grains.radius[a], rb = grains.radius[b];
    const Shares shares = law == ForceLaw::total ? strip_shares<ForceLaw::total>(s, ra, rb) : strip_shares<ForceLaw::pressure>(s, ra, rb);
    return {{shares.a, shares.b, 0.0}, s.normal};
  }
  const Vector3 n = cross(wall_normal(wall_of(b)), wall_normal(wall_of(c)));
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

void add_facet_forces(const FacetView& facets, const GrainView& grains, const double* pressure, ForceLaw law,
                      double* force) {
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
    const std::size_t g = facets.vertex[0][f];
    for (int d = 0; d < 3; ++d) force[4 * g + d] += difference * s.share[0] * s.normal[d];
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
      const Shares s = triangle_total(t.area2, t.lab, t.lac, t.lbc, t.ab_ac, at.r[0][i], at.r[1][i], at.r[2][i]);
      swept[i] = (s.a * (t.nx * vx[a] + t.ny * vy[a] + t.nz * vz[a]) + s.b * (t.nx * vx[b] + t.ny * vy[b] + t.nz * vz[b]) +
                  s.c * (t.nx * vx[c] + t.ny * vy[c] + t.nz * vz[c])) / t.area2;
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
      const Shares s = triangle_total(t.area2, t.lab, t.lac, t.lbc, t.ab_ac, at.r[0][i], at.r[1][i], at.r[2][i]);
      const double a = s.a / t.area2, b = s.b / t.area2, c = s.c / t.area2;
      part[0][0][i] = a * t.nx, part[0][1][i] = a * t.ny, part[0][2][i] = a * t.nz;
      part[1][0][i] = b * t.nx, part[1][1][i] = b * t.ny, part[1][2][i] = b * t.nz;
      part[2][0][i] = c * t.nx, part[2][1][i] = c * t.ny, part[2][2][i] = c * t.nz;
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

void throat_lengths(const FacetView& facets, const double* centre, double* length) {
  const auto apart = [&](std::size_t f) {
    const auto row = [centre](std::int32_t c) { return reinterpret_cast<const UnalignedFour&>(centre[3 * static_cast<std::size_t>(c)]); };
    return Four(row(facets.right[f]) - row(facets.left[f]));
  };
  const auto squares = [](const Four& d) { return d * d; };
  std::size_t f = 0;
  for (; f + 4 <= facets.size(); f += 4) {
    const Four a = squares(apart(f)), b = squares(apart(f + 1)), c = squares(apart(f + 2)), d = squares(apart(f + 3));
    const Four ab = __builtin_shufflevector(a, b, 0, 4, 2, 6), ab_y = __builtin_shufflevector(a, b, 1, 5, 3, 7);
    const Four cd = __builtin_shufflevector(c, d, 0, 4, 2, 6), cd_y = __builtin_shufflevector(c, d, 1, 5, 3, 7);
    const Four sum = __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7) +
                     __builtin_shufflevector(ab_y, cd_y, 0, 1, 4, 5);
#pragma omp simd
    for (std::size_t i = 0; i < 4; ++i) length[f + i] = std::sqrt(sum[i]);
  }
  for (; f < facets.size(); ++f) {
    const Four d = squares(apart(f));
    length[f] = std::sqrt(d[0] + d[1] + d[2]);
  }
}

void throat_sections(const FacetView& facets, const GrainView& grains, double* facet_area, double* open_area,
                     double* perimeter) {
  const double* r = grains.radius;
  for_each_triangle_block(facets, grains, [&](const Corners<3>& at, std::size_t first, std::size_t count) {
#pragma omp simd
    for (std::size_t i = 0; i < count; ++i) {
      const Triangle t = triangle(at, i);
      const double ra = at.r[0][i], rb = at.r[1][i], rc = at.r[2][i];
      const double per_lengths = 1.0 / (t.lab * t.lac * t.lbc);
      const Chord ab = chord(ra, rb, t.lab, t.lac * t.lbc * per_lengths);
      const Chord ac = chord(ra, rc, t.lac, t.lab * t.lbc * per_lengths);
      const Chord bc = chord(rb, rc, t.lbc, t.lab * t.lac * per_lengths);
      const double open_a = open_angle(t.ab_ac, t.area2, ab.near, ab.half, ac.near, ac.half);
      const double open_b = open_angle(t.lab * t.lab - t.ab_ac, t.area2, ab.far, ab.half, bc.near, bc.half);
      const double open_c = open_angle(t.lac * t.lac - t.ab_ac, t.area2, ac.far, ac.half, bc.far, bc.half);
      facet_area[first + i] = 0.5 * t.area2;
      open_area[first + i] = 0.5 * (t.area2 - ra * ra * open_a - rb * rb * open_b - rc * rc * open_c - t.lab * ab.half -
                                    t.lac * ac.half - t.lbc * bc.half);
      perimeter[first + i] = ra * open_a + rb * open_b + rc * open_c + open_gap(t.lab - ra - rb) +
                             open_gap(t.lac - ra - rc) + open_gap(t.lbc - rb - rc);
    }
  });
  for (std::size_t f = facets.end[0]; f < facets.end[1]; ++f) {
    const Strip s = strip(facets, grains, f);
    const double ri = r[facets.vertex[0][f]], rj = r[facets.vertex[1][f]];
    const double angle_i = angle(s.width, s.rise), angle_j = std::numbers::pi - angle_i;
    const HalfLens h = half_lens(ri, rj, s.edge);
    const double beyond_i = arc_half_angle(ri, s.gap_i), beyond_j = arc_half_angle(rj, s.gap_j);
    facet_area[f] = 0.5 * s.width * (s.gap_i + s.gap_j);
    open_area[f] = facet_area[f] - 0.5 * (ri * ri * angle_i + rj * rj * angle_j) + h.area + half_segment(ri, s.gap_i) +
                   half_segment(rj, s.gap_j);
    // On the wall's line the feet of the two grains' discs are solid.
    const double line = s.width - half_chord(ri, s.gap_i) - half_chord(rj, s.gap_j);
    perimeter[f] = ri * (angle_i - beyond_i) + rj * (angle_j - beyond_j) - h.arcs + open_gap(s.edge - ri - rj) +
                   open_gap(s.gap_i - ri) + open_gap(s.gap_j - rj) + open_gap(line);
  }
  for (std::size_t f = facets.end[1]; f < facets.end[2]; ++f) {
    const Vertex i = facets.vertex[0][f];
    const double ri = r[i], g1 = grains.gap(i, wall_of(facets.vertex[1][f])), g2 = grains.gap(i, wall_of(facets.vertex[2][f]));
    const double beyond_1 = arc_half_angle(ri, g1), beyond_2 = arc_half_angle(ri, g2);
    facet_area[f] = g1 * g2;
    open_area[f] = g1 * g2 - 0.25 * std::numbers::pi * ri * ri + half_segment(ri, g1) + half_segment(ri, g2);
    perimeter[f] = ri * (0.5 * std::numbers::pi - beyond_1 - beyond_2) + open_gap(g1 - ri) + open_gap(g2 - ri) +
                   open_gap(g2 - half_chord(ri, g1)) + open_gap(g1 - half_chord(ri, g2));
  }
}

}  // namespace poreslip::geometry
