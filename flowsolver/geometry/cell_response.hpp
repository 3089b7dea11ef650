// What pressures in cells answer to moving grains, and what they do to them, from the gradients of the cells' volumes, which
// stand still: V_c gains sum_g dV_c/dx_g . dx_g, p_c loses that over beta V_c, F_g = sum_c p_c dV_c/dx_g. Pure functions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace poreslip::geometry {

// Three components and one that is not used: one vector register.
using Four [[gnu::vector_size(32)]] = double;

// Gradients dV_c/dx_g, m^2, with respect to the first three vertices of each cell. The fourth's is minus their sum: no volume changes
// when all four move alike. A vertex that is a wall is listed as the grain past the last one, which stays at rest; a cell with
// walls has them last.
struct CellGradients {
  std::vector<std::array<std::int32_t, 4>> grain;
  std::vector<double> gradient;  // (cells, 9), and one more
};

// Volumes that cells [first, last) gain by the displacements (grains + 1), m, of their grains. Adds to gained (cells), m^3.
void add_gained_volumes(const CellGradients& cells, const Four* displacement, std::size_t first, std::size_t last, double* gained);

// Forces of the pressures (cells) on grains; adds to the first three components of force (grains + 1), N.
void add_cell_forces(const CellGradients& cells, const double* pressure, std::size_t first, std::size_t last, Four* force);

// Pressures of cells over an interval: start + time * drift - stiffness * swept.
struct CellPressures {
  const double* start;      // Pa
  const double* drift;      // Pa/s
  const double* stiffness;  // Pa/m^3: 1 / (beta V), or 0 where no volume changes the pressure
  double* swept;            // m^3, gained since the start
  double at(std::size_t cell, double time) const { return start[cell] + time * drift[cell] - stiffness[cell] * swept[cell]; }
};

// The answer to one step of length dt that ends at `time`, and the forces of the new pressures, in one pass over cells [first, last).
// by_walls (last - first), m^3, or null: what the walls add to the cells' volumes. Adds to swept and to force; returns the volumes
// gained times the mean of the pressures before and after, J.
double answer(const CellGradients& cells, const Four* displacement, const double* by_walls, const CellPressures& pressures, double time,
              double dt, std::size_t first, std::size_t last, Four* force);

}  // namespace poreslip::geometry
