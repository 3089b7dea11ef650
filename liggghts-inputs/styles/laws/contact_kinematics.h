// Relative motion of two spheres at their contact point, also when they do not touch.
#pragma once

#include <array>
#include <cmath>

namespace poreslip::laws {

using Vector3 = std::array<double, 3>;

inline double dot(const Vector3 &a, const Vector3 &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double norm(const Vector3 &a) { return std::sqrt(dot(a, a)); }

struct ContactKinematics {
  double distance;           // of the centres, m
  double overlap;            // R_i + R_j - distance, m; negative across a gap
  Vector3 normal;            // unit vector from j to i
  double arm_i, arm_j;       // centre to contact point, m
  double normal_velocity;    // of i relative to j along the normal, m/s; positive when parting
  Vector3 tangent_velocity;  // of i relative to j at the contact point, rotation included, m/s
};

// separation = x_i - x_j. Swapping i and j negates the vectors and changes no bit of the rest, so
// that the two copies of a contact that spans two ranks stay alike.
inline ContactKinematics contact_kinematics(const Vector3 &separation, double distance, double radius_i,
                                            double radius_j, const double *v_i, const double *v_j,
                                            const double *omega_i, const double *omega_j)
{
  ContactKinematics k;
  k.distance = distance;
  k.overlap = (radius_i + radius_j) - distance;
  const double inverse = 1.0 / distance;
  for (int c = 0; c < 3; ++c) k.normal[c] = separation[c] * inverse;
  k.arm_i = radius_i - 0.5 * k.overlap;
  k.arm_j = radius_j - 0.5 * k.overlap;
  const Vector3 v = {v_i[0] - v_j[0], v_i[1] - v_j[1], v_i[2] - v_j[2]};
  k.normal_velocity = dot(v, k.normal);
  Vector3 w;  // rolling part of the surface velocity, per unit normal
  for (int c = 0; c < 3; ++c) w[c] = k.arm_i * omega_i[c] + k.arm_j * omega_j[c];
  const Vector3 &n = k.normal;
  for (int c = 0; c < 3; ++c) k.tangent_velocity[c] = v[c] - k.normal_velocity * n[c];
  k.tangent_velocity[0] -= n[2] * w[1] - n[1] * w[2];
  k.tangent_velocity[1] -= n[0] * w[2] - n[2] * w[0];
  k.tangent_velocity[2] -= n[1] * w[0] - n[0] * w[1];
  return k;
}

}  // namespace poreslip::laws
