// The equations of one rank's unknowns, row by row as they are made.
#pragma once

#include <petscsys.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace poreslip::flow {

// The entries of this rank's rows: couplings with its own unknowns (counted on this rank), and those with unknowns of other ranks (counted over
// all ranks until PETSc takes them up). Columns rise along a row, but for its diagonal where that comes first.
struct Entries {
  bool diagonal_first = false;
  std::vector<PetscInt> start{0}, column, other_start{0}, other_column;
  std::vector<PetscScalar> value, other_value;

  std::size_t rows() const { return start.size() - 1; }
  PetscInt diagonal(PetscInt row) const {
    PetscInt place = start[row];
    while (column[place] != row) ++place;
    return place;
  }
};

// One pore's balance, from its throats one by one.
struct Row {
  static constexpr int most = 4;
  double diagonal = 0.0, right = 0.0;
  double terms = 0.0;             // the sum of the sizes of what is in `right`
  double given = 0.0;             // conductance to pores whose pressure is given
  int count = 0;
  std::array<PetscInt, most> column;
  std::array<double, most> conductance;

  // Throat to an unknown (counted over all ranks), or to a pore of given pressure (other < 0). Flow out is conductance * (p - p_other + head).
  void add(PetscInt other, double c, double head, double pressure, double reference) {
    diagonal += c;
    right -= c * head;
    terms += c * std::abs(head);
    if (other < 0) {
      given += c;
      right += c * (pressure - reference);
      terms += c * std::abs(pressure);
      return;
    }
    int k = count;
    while (k > 0 && column[k - 1] > other) --k;
    // Two pores can have several throats in common in the smallest packs, and a pore one with its own image.
    if (k > 0 && column[k - 1] == other) {
      conductance[k - 1] += c;
      return;
    }
    for (int p = count++; p > k; --p) {
      column[p] = column[p - 1];
      conductance[p] = conductance[p - 1];
    }
    column[k] = other;
    conductance[k] = c;
  }

  // A throat from a pore to its own image drives nothing.
  void drop(PetscInt own) {
    for (int k = 0; k < count; ++k) {
      if (column[k] != own) continue;
      diagonal -= conductance[k];
      for (--count; k < count; ++k) {
        column[k] = column[k + 1];
        conductance[k] = conductance[k + 1];
      }
    }
  }
};

// Writes rows one after another: the first time their columns too.
class EntryWriter {
 public:
  EntryWriter(Entries& entries, PetscInt rows, PetscInt first_row, bool columns)
      : entries_(entries), rows_(rows), first_row_(first_row), columns_(columns) {
    if (!columns) return;
    // What is never written takes no memory.
    const std::size_t most = (1 + Row::most) * static_cast<std::size_t>(rows);
    entries.start.reserve(rows + 1);
    entries.other_start.reserve(rows + 1);
    entries.column.reserve(most);
    entries.value.reserve(most);
  }

  void write(const Row& row) {
    bool pending = !entries_.diagonal_first;
    if (entries_.diagonal_first) put(entries_.column, entries_.value, place_, row_, row.diagonal);
    for (int k = 0; k < row.count; ++k) {
      const PetscInt column = row.column[k] - first_row_;
      if (column < 0 || column >= rows_) {
        put(entries_.other_column, entries_.other_value, other_place_, row.column[k], -row.conductance[k]);
        continue;
      }
      if (pending && column > row_) {
        put(entries_.column, entries_.value, place_, row_, row.diagonal);
        pending = false;
      }
      put(entries_.column, entries_.value, place_, column, -row.conductance[k]);
    }
    if (pending) put(entries_.column, entries_.value, place_, row_, row.diagonal);
    ++row_;
    if (!columns_) return;
    entries_.start.push_back(static_cast<PetscInt>(place_));
    entries_.other_start.push_back(static_cast<PetscInt>(other_place_));
  }

 private:
  void put(std::vector<PetscInt>& column, std::vector<PetscScalar>& value, std::size_t& place, PetscInt c, double v) {
    if (columns_) {
      column.push_back(c);
      value.push_back(v);
    } else {
      value[place] = v;
    }
    ++place;
  }

  Entries& entries_;
  PetscInt rows_, first_row_, row_ = 0;
  bool columns_;
  std::size_t place_ = 0, other_place_ = 0;
};

}  // namespace poreslip::flow
