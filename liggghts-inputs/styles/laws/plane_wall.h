// A rigid frictionless plane: its force on one grain, and the speed of its stress servo.
#pragma once

#include <algorithm>
#include <cmath>

namespace poreslip::laws {

// Push of the plane on a grain along the plane's normal, N. `approach` is the speed at which grain
// and plane near each other. The dashpot cannot make the plane pull.
inline double plane_force(double stiffness, double dashpot, double overlap, double approach)
{
  return overlap > 0.0 ? std::max(0.0, stiffness * overlap + dashpot * approach) : 0.0;
}

struct ServoSpeed {
  double into_grains;  // m/s, positive towards the grains
  bool limited;        // the speed was cut to the limit
};

// The speed that would close a gain-th part of the force error in one step, if all of the present
// contacts answered with their normal stiffness.
inline ServoSpeed servo_speed(double gain, double target, double force, double stiffness, double contacts,
                              double dt, double speed_limit)
{
  const double speed = gain * (target - force) / (stiffness * std::max(contacts, 1.0) * dt);
  if (std::fabs(speed) <= speed_limit) return {speed, false};
  return {std::copysign(speed_limit, speed), true};
}

}  // namespace poreslip::laws
