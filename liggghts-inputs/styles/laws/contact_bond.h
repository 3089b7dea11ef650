// The linear contact bond (Potyondy & Cundall 2004; PFC's "linearcbond") and the frictional contact
// it becomes when it breaks (Cundall & Strack 1979). Forces of the springs only: viscous damping
// takes no part in breaking. Compression is positive.
#pragma once

#include <cmath>

#include "contact_kinematics.h"

namespace poreslip::laws {

// Stored per contact as a double, so that it travels and restarts with the contact's history.
enum class BondState { never_bonded = 0, bonded = 1, broken_in_tension = 2, broken_in_shear = 3 };

struct Springs {
  double normal;  // k_n, N/m
  double shear;   // k_s, N/m
};

// A bond across a gap is stress-free at the gap it was made at: offset = overlap at bonding if that
// was negative, otherwise 0. Unbonded contacts have offset 0 and no tension.
inline double bond_offset(double overlap_at_bonding) { return std::fmin(overlap_at_bonding, 0.0); }

inline double bonded_normal_force(const Springs &k, double overlap, double offset)
{
  return k.normal * (overlap - offset);
}

inline double frictional_normal_force(const Springs &k, double overlap)
{
  return overlap > 0.0 ? k.normal * overlap : 0.0;
}

struct BondLimits {
  double tension;  // T, N
  double shear;    // S, N
};

// T = strength * pi min(R_i, R_j)^2, S = shear_ratio * T. Zero wins over infinity.
inline BondLimits bond_limits(double strength, double shear_ratio, double radius_i, double radius_j)
{
  constexpr double pi = 3.1415926535897932384626433832795;
  const double radius = std::fmin(radius_i, radius_j);
  const double tension = strength * pi * radius * radius;
  const double shear = tension == 0.0 || shear_ratio == 0.0 ? 0.0 : shear_ratio * tension;
  return {tension, shear};
}

// Tension is looked at first, as in PFC. Strict: a bond at its limit holds.
inline BondState bond_state_under(const BondLimits &limits, double normal_force, double shear_force)
{
  if (-normal_force > limits.tension) return BondState::broken_in_tension;
  if (shear_force > limits.shear) return BondState::broken_in_shear;
  return BondState::bonded;
}

// Advance the shear displacement over one step and turn it into the tangent plane.
inline void advance_shear(double *shear, const double *tangent_velocity, const double *normal, double dt)
{
  for (int c = 0; c < 3; ++c) shear[c] += tangent_velocity[c] * dt;
  const double along = shear[0] * normal[0] + shear[1] * normal[1] + shear[2] * normal[2];
  for (int c = 0; c < 3; ++c) shear[c] -= along * normal[c];
}

struct ShearForce {
  Vector3 on_i;
  bool slipping;
};

// Coulomb: |F_s| <= friction * |F_n|. While slipping the dashpot is off, and with `update` the
// spring is shortened to the force it can carry.
inline ShearForce frictional_shear_force(double stiffness, double dashpot, double friction_limit, double *shear,
                                         const double *tangent_velocity, bool update)
{
  ShearForce force{{-(stiffness * shear[0]), -(stiffness * shear[1]), -(stiffness * shear[2])}, false};
  const double length = std::sqrt(shear[0] * shear[0] + shear[1] * shear[1] + shear[2] * shear[2]);
  const double magnitude = stiffness * length;
  if (magnitude > friction_limit) {
    force.slipping = true;
    const double ratio = friction_limit / magnitude;
    for (int c = 0; c < 3; ++c) {
      force.on_i[c] *= ratio;
      if (update) shear[c] = -force.on_i[c] / stiffness;
    }
  } else {
    for (int c = 0; c < 3; ++c) force.on_i[c] -= dashpot * tangent_velocity[c];
  }
  return force;
}

inline Vector3 bonded_shear_force(double stiffness, double dashpot, const double *shear, const double *tangent_velocity)
{
  Vector3 force;
  for (int c = 0; c < 3; ++c) force[c] = -(stiffness * shear[c]) - dashpot * tangent_velocity[c];
  return force;
}

inline double spring_energy(const Springs &k, double normal_force, double shear_force)
{
  const double normal = normal_force * normal_force / (2.0 * k.normal);
  const double shear = k.shear > 0.0 ? shear_force * shear_force / (2.0 * k.shear) : 0.0;
  return normal + shear;
}

}  // namespace poreslip::laws
