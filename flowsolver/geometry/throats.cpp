#include "geometry/throats.hpp"

#include <cstring>
#include <numbers>
#include <vector>

#include "geometry/angle.hpp"
#include "geometry/cells.hpp"
#include "geometry/facet_blocks.hpp"
#include "geometry/walls.hpp"

namespace poreslip::geometry {
namespace {

using Four [[gnu::vector_size(32), gnu::may_alias]] = double;

inline double open_gap(double length) { return std::max(length, 0.0); }

// Two discs with centres at a distance of this square: either they have a gap, m, or a chord in common. The chord, times twice the distance
// of the centres: its own distances from these along their line, and half its length, zero where one disc lies within the other.
struct Chord {
  double near, far, half, gap;
};
inline Chord chord(double ra, double rb, double square) {
  const double sum = ra + rb, difference = ra - rb, overlap = sum * sum - square;
  const bool apart = overlap < 0.0;
  // One root for both.
  const double root = std::sqrt(apart ? square : std::max(overlap * (square - difference * difference), 0.0));
  return {square + sum * difference, square - sum * difference, apart ? 0.0 : root, apart ? root - sum : 0.0};
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

// A chord at distance d from a disc's centre: half its length, half the angle of its arc, and half the area of the segment
// beyond it. All are zero where it misses the disc; beyond the far side the segment is the disc.
inline double half_chord(double radius, double d) { return std::sqrt(std::max((radius - d) * (radius + d), 0.0)); }
inline double arc_half_angle(double radius, double d) { return angle(half_chord(radius, d), d); }
inline double half_segment(double radius, double d) {
  return 0.5 * (radius * radius * arc_half_angle(radius, d) - d * half_chord(radius, d));
}

struct Block {
  alignas(64) double facet_area[block_size], open_area[block_size], perimeter[block_size], length[block_size];
};

void triangles(const Corners<3>& at, std::size_t count, Block& out) {
#pragma omp simd
  for (std::size_t i = 0; i < count; ++i) {
    const Triangle t = triangle(at, i);
    const double ra = at.r[0][i], rb = at.r[1][i], rc = at.r[2][i];
    const Chord ab = chord(ra, rb, t.ab2), ac = chord(ra, rc, t.ac2), bc = chord(rb, rc, t.bc2);
    const double arc_a = ra * open_angle(t.ab_ac, t.area2, ab.near, ab.half, ac.near, ac.half);
    const double arc_b = rb * open_angle(t.ab2 - t.ab_ac, t.area2, ab.far, ab.half, bc.near, bc.half);
    const double arc_c = rc * open_angle(t.ac2 - t.ab_ac, t.area2, ac.far, ac.half, bc.far, bc.half);
    out.facet_area[i] = 0.5 * t.area2;
    out.open_area[i] = 0.5 * (t.area2 - ra * arc_a - rb * arc_b - rc * arc_c) - 0.25 * (ab.half + ac.half + bc.half);
    out.perimeter[i] = arc_a + arc_b + arc_c + ab.gap + ac.gap + bc.gap;
  }
}

void strips(const StripCorners& at, std::size_t count, Block& out) {
#pragma omp simd
  for (std::size_t i = 0; i < count; ++i) {
    const Strip s = strip(at, i);
    const double ri = at.radius[0][i], rj = at.radius[1][i];
    // The overlap of the two grains, and those with the wall, are counted once.
    const Chord overlap = chord(ri, rj, s.edge * s.edge);
    const double angle_i = angle(s.width, s.rise), beyond_i = arc_half_angle(ri, s.gap_i), beyond_j = arc_half_angle(rj, s.gap_j);
    const double arc_i = ri * (angle_i - angle(overlap.half, overlap.near) - beyond_i);
    const double arc_j = rj * (std::numbers::pi - angle_i - angle(overlap.half, overlap.far) - beyond_j);
    const double foot_i = half_chord(ri, s.gap_i), foot_j = half_chord(rj, s.gap_j);
    out.facet_area[i] = 0.5 * s.width * (s.gap_i + s.gap_j);
    out.open_area[i] = out.facet_area[i] - 0.5 * (ri * arc_i + rj * arc_j + s.gap_i * foot_i + s.gap_j * foot_j) - 0.25 * overlap.half;
    // On the wall's line the feet of the two grains' discs are solid.
    out.perimeter[i] = arc_i + arc_j + overlap.gap + open_gap(s.gap_i - ri) + open_gap(s.gap_j - rj) +
                       open_gap(s.width - foot_i - foot_j);
  }
}

void rectangles(const FacetView& facets, const GrainView& grains, std::size_t first, std::size_t count, Block& out) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t f = first + i;
    const Vertex g = facets.vertex[0][f];
    const double r = grains.radius[g], g1 = grains.gap(g, wall_of(facets.vertex[1][f])), g2 = grains.gap(g, wall_of(facets.vertex[2][f]));
    const double beyond_1 = arc_half_angle(r, g1), beyond_2 = arc_half_angle(r, g2);
    out.facet_area[i] = g1 * g2;
    out.open_area[i] = g1 * g2 - 0.25 * std::numbers::pi * r * r + half_segment(r, g1) + half_segment(r, g2);
    out.perimeter[i] = r * (0.5 * std::numbers::pi - beyond_1 - beyond_2) + open_gap(g1 - r) + open_gap(g2 - r) +
                       open_gap(g2 - half_chord(r, g1)) + open_gap(g1 - half_chord(r, g2));
  }
}

// Distances between the centroids of cells on either side of facets.
class Lengths {
 public:
  Lengths(const FacetView& facets, const CellView& cells, const GrainView& grains)
      : facets_(facets), cells_(cells), grains_(grains), walled_(cells.size() - cells.end[0]) {
    for (std::size_t k = 0; k < walled_.size(); ++k) walled_[k] = cell_centroid(cells, grains, cells.end[0] + k);
  }

  void of(std::size_t first, std::size_t count, double* length) {
    // The centroids of two tetrahedra with a common facet are a quarter of their apexes' distance apart.
    const Vertex *l = facets_.left_apex + first, *r = facets_.right_apex + first;
    ask_ahead(facets_.left_apex, first);
    ask_ahead(facets_.right_apex, first);
    Vertex any_wall = 0;
    for (std::size_t i = 0; i < count; ++i) any_wall |= l[i] | r[i];
    const auto squares = [&](std::size_t i) {
      const auto at = [this](Vertex v) { return reinterpret_cast<const Four&>(grains_.packed[std::max(v, 0)]); };
      const Four d = at(r[i]) - at(l[i]);
      return d * d;
    };
    std::size_t i = 0;
    for (; i + 4 <= count; i += 4) {
      const Four a = squares(i), b = squares(i + 1), c = squares(i + 2), d = squares(i + 3);
      const Four ab = __builtin_shufflevector(a, b, 0, 4, 2, 6), ab_y = __builtin_shufflevector(a, b, 1, 5, 3, 7);
      const Four cd = __builtin_shufflevector(c, d, 0, 4, 2, 6), cd_y = __builtin_shufflevector(c, d, 1, 5, 3, 7);
      const Four sum = __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7) +
                       __builtin_shufflevector(ab_y, cd_y, 0, 1, 4, 5);
#pragma omp simd
      for (std::size_t k = 0; k < 4; ++k) length[i + k] = 0.25 * std::sqrt(sum[k]);
    }
    for (; i < count; ++i) {
      const Four d = squares(i);
      length[i] = 0.25 * std::sqrt(d[0] + d[1] + d[2]);
    }
    if (first < facets_.end[0] && !is_wall(any_wall)) return;
    for (i = 0; i < count; ++i) {
      const std::size_t left = facets_.left[first + i], right = facets_.right[first + i];
      if (std::max(left, right) >= cells_.end[0]) length[i] = norm(centroid(right) - centroid(left));
    }
  }

 private:
  Vector3 centroid(std::size_t c) const { return c < cells_.end[0] ? cell_centroid(cells_, grains_, c) : walled_[c - cells_.end[0]]; }

  const FacetView& facets_;
  const CellView& cells_;
  const GrainView& grains_;
  std::vector<Vector3> walled_;  // of the cells that have walls
};

// Rounding of a perimeter, of the root of the facet's area.
constexpr double least_perimeter = 1e-12;

}  // namespace

std::size_t duct_conductances(const ThroatBlock& throats, double viscosity, double least_open_share, const bool* counted, double* conductance) {
  // Whoever reads these by way of the block has compilers gather them one by one.
  const double *const facet_area = throats.facet_area, *const open_area = throats.open_area, *const perimeters = throats.perimeter,
                      *const length = throats.length;
  std::size_t raised = 0;
#pragma omp simd reduction(+ : raised)
  for (std::size_t k = 0; k < throats.count; ++k) {
    const double facet = facet_area[k], least = least_open_share * facet, area = std::max(open_area[k], std::max(least, 0.0));
    // Overlaps can leave no perimeter, but for rounding; then there is no throat. They can leave less than the limited area must have: no
    // shape has less than a circle.
    const double perimeter = perimeters[k], least_square = 4.0 * std::numbers::pi * area;
    const double square = perimeter * perimeter, c = 3.0 * area * area * area / (5.0 * viscosity * std::max(square, least_square) * length[k]);
    conductance[k] = perimeter > 0.0 && square > least_perimeter * least_perimeter * facet ? c : 0.0;
    raised += open_area[k] < least;
  }
  if (!std::memchr(counted, 0, throats.count)) return raised;
  for (std::size_t k = 0; k < throats.count; ++k) {
    if (counted[k]) continue;
    conductance[k] = 0.0;
    raised -= throats.open_area[k] < least_open_share * throats.facet_area[k];
  }
  return raised;
}

void for_each_throat_block(const FacetView& facets, const CellView& cells, const GrainView& grains,
                           const std::function<void(const ThroatBlock&)>& visit) {
  Block block;
  Lengths lengths(facets, cells, grains);
  const auto hand_over = [&](std::size_t first, std::size_t count) {
    lengths.of(first, count, block.length);
    visit({first, count, block.facet_area, block.open_area, block.perimeter, block.length});
  };
  for_each_triangle_block(facets, grains, [&](const Corners<3>& at, std::size_t first, std::size_t count) {
    triangles(at, count, block);
    hand_over(first, count);
  });
  StripCorners at;
  for (std::size_t first = facets.end[0]; first < facets.end[2];) {
    const bool strip = first < facets.end[1];
    const std::size_t count = std::min(block_size, facets.end[strip ? 1 : 2] - first);
    if (strip) {
      at.fetch(facets, grains, first, count);
      strips(at, count, block);
    } else {
      rectangles(facets, grains, first, count, block);
    }
    hand_over(first, count);
    first += count;
  }
}

}  // namespace poreslip::geometry
