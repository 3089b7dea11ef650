// The equations of one rank's unknowns: which entries there are, and where throats stand among them.
#pragma once

#include <petscsys.h>

#include <array>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

namespace poreslip::flow {

// One side of a throat: the row of its pore, -1 if that is no unknown of this rank, and the place of the coupling with the pore on the other
// side among the entries, -1 if that one's pressure is given.
struct Side {
  std::int32_t row = -1, other = -1;
};

// The entries of this rank's rows: couplings with its own unknowns (counted on this rank), row by row in the order of their columns, and
// after all of these those with unknowns of other ranks (counted over all).
struct Entries {
  std::vector<PetscInt> start{0}, column, other_start{0}, other_column;
  std::vector<std::int32_t> diagonal;  // (rows) places
  std::vector<PetscScalar> value;      // (entries)
};

// Collects the entries of rows with a diagonal and up to four neighbours each.
class EntryCollector {
 public:
  EntryCollector(std::size_t rows, PetscInt first_row) : first_row_(first_row), rows_(rows), column_(rows * width), filled_(rows, 1) {
    for (std::size_t k = 0; k < rows; ++k) column_[k * width] = first_row + static_cast<PetscInt>(k);
  }

  bool owns(PetscInt row) const { return row >= first_row_ && row < first_row_ + static_cast<PetscInt>(rows_); }

  // A side of a throat between unknowns, counted over all ranks; other: -1 if its pressure is given. Its place is known after `entries`.
  Side add(PetscInt row, PetscInt other) {
    const auto local = static_cast<std::int32_t>(row - first_row_);
    if (other < 0) return {local, -1};
    // Two pores can have several throats in common in the smallest packs, and a pore one with its own image.
    PetscInt* const c = &column_[local * width];
    int k = 0;
    while (k < filled_[local] && c[k] != other) ++k;
    if (k == filled_[local]) c[filled_[local]++] = other;
    return {local, static_cast<std::int32_t>(local * width) + k};
  }

  Entries entries() {
    Entries e;
    place_.resize(column_.size());
    const auto filled = std::accumulate(filled_.begin(), filled_.end(), std::size_t{0});
    e.diagonal.resize(rows_);
    for (const bool own : {true, false}) {
      std::vector<PetscInt>& start = own ? e.start : e.other_start;
      std::vector<PetscInt>& columns = own ? e.column : e.other_column;
      start.reserve(rows_ + 1);
      if (own) columns.reserve(filled);
      for (std::size_t k = 0; k < rows_; ++k) {
        std::array<std::pair<PetscInt, std::int32_t>, width> found;
        int count = 0;
        for (int s = 0; s < filled_[k]; ++s)
          if (const PetscInt c = column_[k * width + s]; owns(c) == own) {
            int p = count++;
            for (; p > 0 && c < found[p - 1].first; --p) found[p] = found[p - 1];
            found[p] = {c, static_cast<std::int32_t>(k * width) + s};
          }
        for (int s = 0; s < count; ++s) {
          place_[found[s].second] = static_cast<std::int32_t>(e.column.size() + e.other_column.size());
          columns.push_back(own ? found[s].first - first_row_ : found[s].first);
        }
        start.push_back(static_cast<PetscInt>(columns.size()));
      }
    }
    for (std::size_t k = 0; k < rows_; ++k) e.diagonal[k] = place_[k * width];
    e.value.assign(e.column.size() + e.other_column.size(), 0.0);
    return e;
  }

  // After `entries`.
  Side placed(Side side) const { return {side.row, side.other < 0 ? -1 : place_[side.other]}; }

 private:
  static constexpr std::int32_t width = 5;  // the diagonal first
  PetscInt first_row_;
  std::size_t rows_;
  std::vector<PetscInt> column_;     // (rows * width), over all ranks
  std::vector<std::int8_t> filled_;  // (rows)
  std::vector<std::int32_t> place_;  // of column_
};

}  // namespace poreslip::flow
