#include "geometry/cell_response.hpp"

namespace poreslip::geometry {
namespace {

struct Cell {
  const std::array<std::int32_t, 4>& grain;
  Four a, b, c;
  Cell(const CellGradients& cells, std::size_t cell)
      : grain(cells.grain[cell]), a(load(&cells.gradient[9 * cell])), b(load(&cells.gradient[9 * cell + 3])), c(load(&cells.gradient[9 * cell + 6])) {}

  double gained(const Four* displacement) const {
    const Four base = displacement[grain[3]];
    const Four sum = a * (displacement[grain[0]] - base) + b * (displacement[grain[1]] - base) + c * (displacement[grain[2]] - base);
    return (sum[0] + sum[1]) + sum[2];
  }
  void push(double pressure, Four* force) const {
    const Four pa = pressure * a, pb = pressure * b, pc = pressure * c;
    force[grain[0]] += pa;
    force[grain[1]] += pb;
    force[grain[2]] += pc;
    force[grain[3]] -= pa + pb + pc;
  }
};

}  // namespace

void add_gained_volumes(const CellGradients& cells, const Four* displacement, double* gained) {
  for (std::size_t c = 0; c < cells.grain.size(); ++c) gained[c] += Cell(cells, c).gained(displacement);
}

void add_cell_forces(const CellGradients& cells, const double* pressure, Four* force) {
  for (std::size_t c = 0; c < cells.grain.size(); ++c) Cell(cells, c).push(pressure[c], force);
}

}  // namespace poreslip::geometry
