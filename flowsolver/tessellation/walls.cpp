#include <algorithm>
#include <cmath>

#include "tessellation/domain.hpp"

namespace poreslip {
namespace {

// Of the longest side: by so much the triangulation's walls lie outside where there are periods too. Grains whose sphere has its centre in a
// wall, as in lattices with their walls between two layers, are a tie which the wall sphere's curvature would break otherwise in each periodic
// copy. Their sphere about a point this far out, twenty times as far as the curvature moves it, makes a choice that is the same in all.
constexpr double step_aside = 1.3e-6;

}  // namespace

WallSpheres make_wall_spheres(const Domain& domain, const std::vector<double>& wall_position) {
  WallSpheres walls;
  const std::size_t groups = wall_position.size() / 6;
  std::array<double, 3> lower = domain.lower, upper = domain.upper;
  for (int w = 0; w < 6; ++w) {
    walls.present[w] = domain.has_wall(w);
    walls.plane[w] = w % 2 == 0 ? domain.lower[w / 2] : domain.upper[w / 2];
    if (!walls.present[w]) continue;
    walls.plane[w] = wall_position[w];
    for (std::size_t g = 1; g < groups; ++g) {
      const double p = wall_position[6 * g + w];
      walls.plane[w] = w % 2 == 0 ? std::min(walls.plane[w], p) : std::max(walls.plane[w], p);
    }
    (w % 2 == 0 ? lower : upper)[w / 2] = walls.plane[w];
  }
  double longest = 0.0;
  for (int d = 0; d < 3; ++d) longest = std::max(longest, upper[d] - lower[d]);
  // About 1e6 box lengths: flat to 1e-6 of the box, and its plane still resolved to 1e-10 of it. Where there are periods too, the
  // copies of a cell must fall alike although the sphere is not periodic: flatter, 1e-8 of the box in both.
  const bool mixed = domain.periodic[0] || domain.periodic[1] || domain.periodic[2];
  walls.radius = std::ldexp(1.0, std::ilogb(longest) + (mixed ? 26 : 20));
  for (int w = 0; w < 6; ++w) {
    if (mixed && walls.present[w]) walls.plane[w] += (w % 2 == 0 ? -step_aside : step_aside) * longest;
    for (int d = 0; d < 3; ++d) walls.centre[w][d] = 0.5 * (lower[d] + upper[d]);
    walls.centre[w][w / 2] = walls.plane[w] + (w % 2 == 0 ? -walls.radius : walls.radius);
  }
  return walls;
}

}  // namespace poreslip
