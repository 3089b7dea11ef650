#include "geometry/cell_response.hpp"

namespace poreslip::geometry {
namespace {

inline double gained_volume(const std::array<std::int32_t, 4>& grain, const std::array<Four, 4>& gradient, const Four* displacement) {
  const Four sum = (gradient[0] * displacement[grain[0]] + gradient[1] * displacement[grain[1]]) +
                   (gradient[2] * displacement[grain[2]] + gradient[3] * displacement[grain[3]]);
  return (sum[0] + sum[1]) + sum[2];
}

inline void push(const std::array<std::int32_t, 4>& grain, const std::array<Four, 4>& gradient, double pressure, Four* force) {
  for (int k = 0; k < 4; ++k) force[grain[k]] += pressure * gradient[k];
}

}  // namespace

void add_gained_volumes(const CellGradients& cells, const Four* displacement, std::size_t first, std::size_t last, double* gained) {
  for (std::size_t c = first; c < last; ++c) gained[c] += gained_volume(cells.grain[c], cells.gradient[c], displacement);
}

void add_cell_forces(const CellGradients& cells, const double* pressure, std::size_t first, std::size_t last, Four* force) {
  for (std::size_t c = first; c < last; ++c) push(cells.grain[c], cells.gradient[c], pressure[c], force);
}

double answer(const CellGradients& cells, const Four* displacement, const double* stiffness, std::size_t first, std::size_t last,
              double* pressure, double* swept, Four* force) {
  double work = 0.0;
  for (std::size_t c = first; c < last; ++c) {
    const double gained = gained_volume(cells.grain[c], cells.gradient[c], displacement);
    const double before = pressure[c], after = before - stiffness[c] * gained;
    pressure[c] = after;
    swept[c] += gained;
    work += 0.5 * (before + after) * gained;
    push(cells.grain[c], cells.gradient[c], after, force);
  }
  return work;
}

}  // namespace poreslip::geometry
