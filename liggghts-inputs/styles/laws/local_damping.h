// PFC's local damping: a force against the velocity, in proportion to the net force.
#pragma once

#include <cmath>

namespace poreslip::laws {

// F -= alpha |F| sign(v) for each component; nothing where the velocity is exactly zero.
inline void damp_locally(double alpha, const double *velocity, double *force)
{
  for (int c = 0; c < 3; ++c) {
    const double sign = static_cast<double>((velocity[c] > 0.0) - (velocity[c] < 0.0));
    force[c] -= alpha * std::fabs(force[c]) * sign;
  }
}

}  // namespace poreslip::laws
