// Signs that decide a triangulation: a double-precision filter first, the exact predicate where rounding could matter.
#pragma once

#include <array>
#include <cmath>

#include "tessellation/domain.hpp"
#include "tessellation/triangulation.hpp"

namespace poreslip {

// Relative rounding error of the determinants, of the sum of their terms' absolute values: some twenty operations each.
constexpr double relative_error = 1e-14;

// A vertex seen from a grain: direction, and how far it is lifted, |d|^2 - (R^2 - R_a^2). For a wall both over its sphere's
// radius, which keeps all signs.
struct Lifted {
  double d[3];
  double lift;
  double lift_scale;   // sum of the absolute values of the lift's terms
  double lift_error;   // error beyond rounding: the sphere's own coordinates carry fewer digits of the plane
};

Lifted lifted(const LocalGrains& grains, const WallSpheres& walls, Vertex a, Vertex b);

// Sign of the orientation of a cell whose first vertex is a grain. exact_tests counts the undecided.
int orientation_sign(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell,
                     std::int64_t& exact_tests);

// > 0 where the facet (a, b, c), a a grain, fails the power test: e, the apex on its normal's side, lies inside the orthosphere
// of (a, b, c) and the other apex d.
int violation_sign(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 3>& facet, Vertex d, Vertex e,
                   std::int64_t& exact_tests);

}  // namespace poreslip
