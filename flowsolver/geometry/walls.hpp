// Walls as vertices infinitely far away: directions to them.
#pragma once

#include "geometry/vector3.hpp"
#include "geometry/view.hpp"

namespace poreslip::geometry {

// Outward normal of the wall that a vertex is.
inline Vector3 wall_normal(Vertex v) {
  Vector3 n{0.0, 0.0, 0.0};
  n[wall_axis(wall_of(v))] = wall_sign(wall_of(v));
  return n;
}

// Direction from grain a to vertex b: to a grain, the difference of centres; to a wall, its outward normal.
inline Vector3 direction(const GrainView& grains, Vertex a, Vertex b) {
  return is_wall(b) ? wall_normal(b) : grains.position(b) - grains.position(a);
}

}  // namespace poreslip::geometry
