// Small vectors in three dimensions, and the cap of a sphere.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

namespace poreslip {

using Vector3 = std::array<double, 3>;

inline Vector3 operator+(const Vector3& a, const Vector3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vector3 operator-(const Vector3& a, const Vector3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vector3 operator*(double s, const Vector3& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline double dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double norm(const Vector3& a) { return std::sqrt(dot(a, a)); }

// Volume over pi of the part of a sphere beyond a plane at distance d from its centre; zero where the plane misses it.
inline double cap_over_pi(double radius, double d) {
  d = std::min(std::max(d, -radius), radius);
  return (radius - d) * (radius - d) * (2.0 * radius + d) / 3.0;
}

// Volume over 2 pi of the lens common to two spheres with centres at distance l (per_l: 1 / l): both caps cut by the radical
// plane. By Pappus it is also the first moment, about the line of centres, of the lens' half cross-section.
inline double lens_moment(double radius_a, double radius_b, double l, double per_l) {
  const double d_a = 0.5 * (l + (radius_a - radius_b) * (radius_a + radius_b) * per_l);
  return 0.5 * (cap_over_pi(radius_a, d_a) + cap_over_pi(radius_b, l - d_a));
}
inline double lens_over_two_pi(double radius_a, double radius_b, double l) {
  return lens_moment(radius_a, radius_b, l, 1.0 / l);
}

}  // namespace poreslip
