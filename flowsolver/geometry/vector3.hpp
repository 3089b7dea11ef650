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

// Volume over 2 pi of the lens common to two spheres with centres at distance l (per_l: 1 / l), zero where they do not meet and the
// smaller sphere where it lies within the other. By Pappus it is also the first moment, about the line of centres, of the lens'
// half cross-section.
inline double lens_moment(double radius_a, double radius_b, double l, double per_l) {
  const double sum = radius_a + radius_b, difference = std::abs(radius_a - radius_b);
  const double depth = std::max(sum - std::max(l, difference), 0.0);
  const double flattening = std::min(difference * difference * per_l, difference);
  return depth * depth * (std::max(l, difference) + 2.0 * sum - 3.0 * flattening) / 24.0;
}
inline double lens_over_two_pi(double radius_a, double radius_b, double l) {
  return lens_moment(radius_a, radius_b, l, 1.0 / l);
}

}  // namespace poreslip
