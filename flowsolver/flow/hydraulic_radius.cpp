#include "flow/hydraulic_radius.hpp"

#include <algorithm>
#include <cmath>

#include "geometry/facets.hpp"
#include "geometry/vector3.hpp"

namespace poreslip::flow {
namespace {

// Of the radius of the throat's smallest grain.
constexpr double least_length = 3e-4;

// Of the product of its edges' lengths, six times a cell's volume: below this it is flat but for rounding, as between four grains of a lattice on one
// circle, and where its centre lies across its plane is not determined.
constexpr double flat = 1e-9;

Vector3 outward(Vertex wall) {
  Vector3 n{0.0, 0.0, 0.0};
  n[wall_axis(wall_of(wall))] = wall_sign(wall_of(wall));
  return n;
}

// Point of equal power to the cell's grains, on the planes of its walls; relative to a grain of the cell, `origin`.
Vector3 power_centre(const Mesh& mesh, const GrainView& grains, std::size_t cell, Vertex origin) {
  Vector3 row[3];
  double right[3];
  int n = 0;
  for (int k = 0; k < 4; ++k) {
    const Vertex v = mesh.cell_vertex[k][cell];
    if (v == origin) continue;
    if (is_wall(v)) {
      row[n] = outward(v);
      right[n] = grains.gap(origin, wall_of(v));
    } else {
      row[n] = grains.position(v) - grains.position(origin);
      const double r = grains.radius[v], r0 = grains.radius[origin];
      right[n] = 0.5 * (dot(row[n], row[n]) - (r - r0) * (r + r0));
    }
    ++n;
  }
  const Vector3 a = cross(row[1], row[2]), b = cross(row[2], row[0]), c = cross(row[0], row[1]);
  const double det = dot(row[0], a);
  if (std::abs(det) <= flat * norm(row[0]) * norm(row[1]) * norm(row[2])) {
    // The circle's centre, in the plane: between those of the cells on both sides, whose distance it leaves as it is.
    const Vector3* normal[3] = {&a, &b, &c};
    const int k = static_cast<int>(std::max_element(normal, normal + 3, [](const Vector3* p, const Vector3* q) { return dot(*p, *p) < dot(*q, *q); }) - normal);
    const Vector3& across = *normal[k];
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    return (right[i] / dot(across, across)) * cross(row[j], across) + (right[j] / dot(across, across)) * cross(across, row[i]);
  }
  return (right[0] / det) * a + (right[1] / det) * b + (right[2] / det) * c;
}

}  // namespace

ThroatBody throat_body(const Mesh& mesh, const GrainView& grains, std::size_t f) {
  Vertex v[3];
  for (int k = 0; k < 3; ++k) v[k] = mesh.facet.vertex[k][f];
  Vector3 left = power_centre(mesh, grains, mesh.facet.left[f], v[0]);
  Vector3 right = power_centre(mesh, grains, mesh.facet.right[f], v[0]);
  const geometry::FacetShares shares = geometry::facet_shares(mesh.facet.view(), grains, f, geometry::ForceLaw::total);
  const double area = shares.share[0] + shares.share[1] + shares.share[2];
  // Cells of cospherical grains have one centre, and the throat between them no length. It then gets the one that a throat has at least,
  // with the hydraulic radius that short throats tend to; the two pores have all but one pressure.
  double radius = grains.radius[v[0]];
  for (int k = 1; k < 3 && !is_wall(v[k]); ++k) radius = std::min(radius, grains.radius[v[k]]);
  const double lacking = least_length * radius - dot(right - left, shares.normal);
  if (lacking > 0.0) {
    left = left - (0.5 * lacking) * shares.normal;
    right = right + (0.5 * lacking) * shares.normal;
  }
  // A pyramid on the far side of its facet counts as negative: then the two are the body between the centres.
  const double height_left = -dot(left, shares.normal), height_right = dot(right, shares.normal);
  double space = area * (height_left + height_right) / 3.0, surface = 0.0;
  for (int k = 0; k < 3 && !is_wall(v[k]); ++k) {
    const Vector3 to_origin = grains.position(v[0]) - grains.position(v[k]);
    Vector3 d[2];
    int n = 0;
    for (int o = 0; o < 3; ++o)
      if (o != k) d[n++] = is_wall(v[o]) ? outward(v[o]) : grains.position(v[o]) - grains.position(v[k]);
    for (const auto& [centre, height] : {std::pair{left, height_left}, std::pair{right, height_right}}) {
      const Vector3 p = to_origin + centre;
      const double l0 = norm(d[0]), l1 = norm(d[1]), lp = norm(p);
      const double angle = 2.0 * std::atan2(std::abs(dot(p, cross(d[0], d[1]))),
                                            l0 * l1 * lp + dot(d[0], d[1]) * lp + dot(d[1], p) * l0 + dot(d[0], p) * l1);
      const double r = grains.radius[v[k]], part = height > 0.0 ? angle : -angle;
      surface += part * r * r;
      space -= part * r * r * r / 3.0;
    }
  }
  return {surface > 0.0 ? space / surface : 0.0, norm(right - left), lacking > 0.0};
}

}  // namespace poreslip::flow
