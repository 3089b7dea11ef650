// The equations of one rank's unknowns.
#pragma once

#include <petscsys.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "flow/pore_flow.hpp"

namespace poreslip::flow {

// The equations of the unknowns of this rank, in pressures less a reference: a diagonal and up to four neighbours each.
struct PoreFlow::Rows {
  std::vector<double> diagonal, right;                  // by local pore
  std::vector<double> terms;                            // sum of the absolute values of the right side's terms
  std::vector<std::array<double, 4>> value;             // by local pore
  std::vector<std::array<PetscInt, 4>> column;
  std::vector<std::int8_t> filled;

  void couple(std::size_t pore, double conductance, double head, double other_column, double other_pressure,
              double reference) {
    diagonal[pore] += conductance;
    // Flow out of the pore is conductance * (p - p_other + head).
    right[pore] -= conductance * head;
    terms[pore] += conductance * std::abs(head);
    if (other_column < 0.0) {
      right[pore] += conductance * (other_pressure - reference);
      terms[pore] += conductance * std::abs(other_pressure);
      return;
    }
    const auto c = static_cast<PetscInt>(other_column);
    // Two pores can have several throats in common in the smallest packs.
    for (int k = 0; k < filled[pore]; ++k)
      if (column[pore][k] == c) {
        value[pore][k] -= conductance;
        return;
      }
    column[pore][filled[pore]] = c;
    value[pore][filled[pore]++] = -conductance;
  }
};

}  // namespace poreslip::flow
