#include "geometry/containment.hpp"

#include <limits>

#include "geometry/walls.hpp"

namespace poreslip::geometry {
namespace {

constexpr double outside = -std::numeric_limits<double>::infinity();

double in_tetrahedron(const std::array<Vector3, 4>& at, const Vector3& point) {
  const auto volume = [](const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) { return dot(cross(b - a, c - a), d - a); };
  const double whole = volume(at[0], at[1], at[2], at[3]);
  if (!(whole > 0.0)) return outside;
  double least = whole;
  for (int k = 0; k < 4; ++k) {
    std::array<Vector3, 4> with = at;
    with[k] = point;
    least = std::min(least, volume(with[0], with[1], with[2], with[3]));
  }
  return least / whole;
}

// From 0 at a grain's height, or the height between grains, to 1 at the wall, and back: how far from either end.
double between(double height, double gap) { return gap > 0.0 ? std::min(height / gap, 1.0 - height / gap) : outside; }

// Columns over a triangle, up to the wall.
double in_prism(const GrainView& grains, const Vertex* v, const Vector3& point) {
  const Vector3 normal = wall_normal(v[3]);
  const Vector3 from[3] = {grains.position(v[0]) - point, grains.position(v[1]) - point, grains.position(v[2]) - point};
  const double whole = dot(cross(from[1] - from[0], from[2] - from[0]), normal);
  if (!(whole > 0.0)) return outside;
  double least = 1.0, gap = 0.0, height = 0.0;
  for (int k = 0; k < 3; ++k) {
    const double share = dot(cross(from[(k + 1) % 3], from[(k + 2) % 3]), normal) / whole;
    least = std::min(least, share);
    gap += share * grains.gap(v[k], wall_of(v[3]));
    height -= share * dot(from[k], normal);
  }
  return least < 0.0 ? least : std::min(least, between(height, gap));
}

// Rectangles along the line between two grains, out to two walls.
double in_wedge(const GrainView& grains, const Vertex* v, const Vector3& point) {
  const Vector3 along = cross(wall_normal(v[2]), wall_normal(v[3]));
  const Vector3 from = point - grains.position(v[0]), line = grains.position(v[1]) - grains.position(v[0]);
  const double length = dot(line, along);
  if (!(length > 0.0)) return outside;
  const double share = dot(from, along) / length;
  double least = std::min(share, 1.0 - share);
  if (least < 0.0) return least;
  for (int k = 2; k < 4; ++k) {
    const double gap = (1.0 - share) * grains.gap(v[0], wall_of(v[k])) + share * grains.gap(v[1], wall_of(v[k]));
    least = std::min(least, between(dot(from - share * line, wall_normal(v[k])), gap));
  }
  return least;
}

double in_corner(const GrainView& grains, const Vertex* v, const Vector3& point) {
  double least = 1.0;
  for (int k = 1; k < 4; ++k)
    least = std::min(least, between(dot(point - grains.position(v[0]), wall_normal(v[k])), grains.gap(v[0], wall_of(v[k]))));
  return least;
}

}  // namespace

double depth_in_cell(const CellView& cells, const GrainView& grains, std::size_t cell, const Vector3& point) {
  Vertex v[4];
  for (int k = 0; k < 4; ++k) v[k] = cells.vertex[k][cell];
  if (cell < cells.end[0]) return in_tetrahedron({grains.position(v[0]), grains.position(v[1]), grains.position(v[2]), grains.position(v[3])}, point);
  if (cell < cells.end[1]) return in_prism(grains, v, point);
  if (cell < cells.end[2]) return in_wedge(grains, v, point);
  return in_corner(grains, v, point);
}

}  // namespace poreslip::geometry
