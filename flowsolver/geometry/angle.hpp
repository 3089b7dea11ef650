// The angle of a vector in a plane, to within two units in the last place, in a form that compilers vectorise.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace poreslip::geometry {

// atan2(y, x); 0 for the null vector.
inline double angle(double y, double x) {
  const double ay = std::abs(y), ax = std::abs(x);
  const double low = std::min(ay, ax), high = std::max(ay, ax);
  // atan(low / high), by way of pi / 4 where that is nearer than 0: the argument stays below tan(pi / 8).
  const bool middle = low > 0.41421356237309503 * high;
  const double t = (middle ? low - high : low) / ((middle ? low + high : high) + std::numeric_limits<double>::min());
  const double z = t * t;
  // (atan(t) / t - 1) / t^2 on [0, tan(pi / 8)^2], Chebyshev's fit of degree 10; relative error of the whole 7e-18.
  double s = -0.01917392228554793;
  s = s * z + 0.03922923713835943;
  s = s * z - 0.05085365922344248;
  s = s * z + 0.05858132894427922;
  s = s * z - 0.06664509603255386;
  s = s * z + 0.07692183059894114;
  s = s * z - 0.09090904572487347;
  s = s * z + 0.11111111015117626;
  s = s * z - 0.1428571428466482;
  s = s * z + 0.19999999999995513;
  s = s * z - 0.3333333333333333;
  double a = (middle ? 0.25 * std::numbers::pi : 0.0) + (t + t * z * s);
  a = ay > ax ? 0.5 * std::numbers::pi - a : a;
  a = x < 0.0 ? std::numbers::pi - a : a;
  return std::copysign(a, y);
}

}  // namespace poreslip::geometry
