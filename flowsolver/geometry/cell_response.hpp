// What pressures in cells answer to moving grains, and what they do to them, from the gradients of the cells' volumes, which
// stand still: V_c gains sum_g dV_c/dx_g . dx_g, p_c loses that over beta V_c, F_g = sum_c p_c dV_c/dx_g. Pure functions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "geometry/four.hpp"

namespace poreslip::geometry {

// Gradients dV_c/dx_g, m^2, with respect to the first three vertices of each cell. The fourth's is minus their sum: no volume changes
// when all four move alike. A vertex that is a wall is listed as the grain past the last one, which stays at rest; a cell with
// walls has them last.
struct CellGradients {
  std::vector<std::array<std::int32_t, 4>> grain;
  std::vector<double> gradient;  // (cells, 9), and one more
};

// Volumes that cells gain by the displacements (grains + 1), m, of their grains. Adds to gained (cells), m^3.
void add_gained_volumes(const CellGradients& cells, const Four* displacement, double* gained);

// Forces of the pressures (cells) on grains; adds to the first three components of force (grains + 1), N.
void add_cell_forces(const CellGradients& cells, const double* pressure, Four* force);

}  // namespace poreslip::geometry
