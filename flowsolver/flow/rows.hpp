// The equations of one rank's unknowns.
#pragma once

#include <petscsys.h>

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace poreslip::flow {

// The equations of the unknowns of this rank, in pressures less a reference: a diagonal and up to four neighbours each.
struct Rows {
  static constexpr std::size_t width = 5;   // entries of a row, the diagonal first until compress()
  std::vector<PetscScalar> value;           // (rows * width)
  std::vector<PetscInt> column;             // (rows * width)
  std::vector<std::int8_t> filled;          // (rows)
  std::vector<double> right, terms;         // (rows): right side, and the sum of its terms' absolute values

  Rows(std::size_t rows, PetscInt first_row)
      : value(rows * width, 0.0), column(rows * width), filled(rows, 1), right(rows, 0.0), terms(rows, 0.0) {
    for (std::size_t k = 0; k < rows; ++k) column[k * width] = first_row + static_cast<PetscInt>(k);
  }

  std::size_t size() const { return filled.size(); }
  double& diagonal(std::size_t row) { return value[row * width]; }
  double sum(std::size_t row) const {
    double entries = 0.0;
    for (int e = 0; e < filled[row]; ++e) entries += value[row * width + e];
    return entries;
  }

  // other: global number of the pore on the other side, -1 if its pressure is given.
  void couple(std::size_t row, double conductance, double head, PetscInt other, double other_pressure, double reference) {
    PetscScalar* v = &value[row * width];
    PetscInt* c = &column[row * width];
    v[0] += conductance;
    // Flow out of the pore is conductance * (p - p_other + head).
    right[row] -= conductance * head;
    terms[row] += conductance * std::abs(head);
    if (other < 0) {
      right[row] += conductance * (other_pressure - reference);
      terms[row] += conductance * std::abs(other_pressure);
      return;
    }
    // Two pores can have several throats in common in the smallest packs, and a pore one with its own image.
    for (int k = 0; k < filled[row]; ++k)
      if (c[k] == other) {
        v[k] -= conductance;
        return;
      }
    c[filled[row]] = other;
    v[filled[row]++] = -conductance;
  }

  // Each row in the order of its columns, the rows one after the other. Returns where each starts (rows + 1).
  std::vector<PetscInt> compress() {
    std::vector<PetscInt> start(size() + 1);
    PetscInt end = 0;
    for (std::size_t k = 0; k < size(); ++k) {
      PetscScalar* v = &value[k * width];
      PetscInt* c = &column[k * width];
      for (int e = 1; e < filled[k]; ++e)
        for (int p = e; p > 0 && c[p] < c[p - 1]; --p) {
          std::swap(c[p], c[p - 1]);
          std::swap(v[p], v[p - 1]);
        }
      start[k] = end;
      for (int e = 0; e < filled[k]; ++e, ++end) {
        column[end] = c[e];
        value[end] = v[e];
      }
    }
    start[size()] = end;
    value.resize(end);
    column.resize(end);
    return start;
  }
};

}  // namespace poreslip::flow
