// Numbering of the unknowns and assembly of their equations, (7) and (10)-(13).
#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "flow/pore_flow.hpp"
#include "flow/rows.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip::flow {
namespace {

// One side of a throat whose pore another rank owns.
struct RemoteSide {
  PetscInt row;          // global number of the pore
  PetscInt column;       // global number of the other pore, -1 if its pressure is given
  double conductance;    // C / l
  double head;           // gain of the body force from that pore to the other
  double pressure;       // of the other pore
};

std::vector<RemoteSide> deliver(MPI_Comm comm, const std::vector<std::vector<RemoteSide>>& out) {
  const int ranks = static_cast<int>(out.size());
  std::vector<int> count(ranks), start(ranks, 0), received_count(ranks), received_start(ranks, 0);
  std::vector<RemoteSide> sent;
  for (int r = 0; r < ranks; ++r) {
    start[r] = static_cast<int>(sent.size());
    count[r] = static_cast<int>(out[r].size());
    sent.insert(sent.end(), out[r].begin(), out[r].end());
  }
  MPI_Alltoall(count.data(), 1, MPI_INT, received_count.data(), 1, MPI_INT, comm);
  for (int r = 1; r < ranks; ++r) received_start[r] = received_start[r - 1] + received_count[r - 1];
  std::vector<RemoteSide> received(received_start.back() + received_count.back());
  MPI_Datatype type;
  MPI_Type_contiguous(sizeof(RemoteSide), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  MPI_Alltoallv(sent.data(), count.data(), start.data(), type, received.data(), received_count.data(),
                received_start.data(), type, comm);
  MPI_Type_free(&type);
  return received;
}

}  // namespace

// Pores that no chain of open throats joins to a given pressure keep their own: without storage nothing determines it. A box in
// which no pressure is given at all is left as it is.
void PoreFlow::fix_cut_off() {
  const bool shut = std::any_of(throats_.conductance.begin(), throats_.conductance.end(), [](double c) { return c == 0.0; });
  const bool given = std::any_of(fixed_.begin(), fixed_.end(), [](double f) { return f != 0.0; });
  if (!any_rank(comm_, shut) || !any_rank(comm_, given)) return;
  const Mesh& mesh = network_.mesh();
  const std::size_t n = network_.pores();
  // Trees of the pores that this rank's own throats join; copies on other ranks join them further.
  std::vector<std::int32_t> parent(n);
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&parent](std::int32_t c) {
    while (parent[c] != c) c = parent[c] = parent[parent[c]];
    return c;
  };
  for (std::size_t t = 0; t < throats_.facet.size(); ++t)
    if (throats_.conductance[t] > 0.0)
      parent[root(mesh.facet.left[throats_.facet[t]])] = root(mesh.facet.right[throats_.facet[t]]);
  std::vector<double> reached = fixed_;
  for (bool changed = true; changed;) {
    std::vector<double> before = reached, of_root(n, 0.0);
    for (std::size_t c = 0; c < n; ++c) of_root[root(c)] += reached[c];
    for (std::size_t c = 0; c < n; ++c) reached[c] = of_root[root(c)] > 0.0 ? 1.0 : 0.0;
    network_.exchange().add_to_owner(reached.data());
    for (double& r : reached) r = std::min(r, 1.0);
    network_.exchange().fetch(reached.data());
    changed = any_rank(comm_, reached != before);
  }
  std::int64_t count = 0;
  for (std::size_t c = 0; c < n; ++c) {
    if (reached[c] > 0.0) continue;
    fixed_[c] = 1.0;
    count += network_.owned()[c];
  }
  cut_off_ = sum(comm_, count);
}

// Numbers the pores whose pressure is not given, rank by rank, along the Hilbert curve.
void PoreFlow::number(const bool* fixed, bool stored) {
  const std::size_t n = network_.pores();
  fixed_.resize(n);
  for (std::size_t c = 0; c < n; ++c) fixed_[c] = fixed[c] ? 1.0 : 0.0;
  network_.exchange().fetch(fixed_.data());
  cut_off_ = 0;
  if (!stored) fix_cut_off();
  free_.clear();
  for (std::size_t c = 0; c < n; ++c)
    if (network_.owned()[c] && fixed_[c] == 0.0) free_.push_back(static_cast<std::int32_t>(c));
  std::int64_t count = static_cast<std::int64_t>(free_.size()), before = 0;
  MPI_Exscan(&count, &before, 1, MPI_INT64_T, MPI_SUM, comm_);
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  if (rank == 0) before = 0;
  first_row_ = static_cast<PetscInt>(before);
  all_rows_ = static_cast<PetscInt>(sum(comm_, count));
  std::vector<double> column(n, -1.0);
  for (std::size_t k = 0; k < free_.size(); ++k) column[free_[k]] = static_cast<double>(before + k);
  network_.exchange().fetch(column.data());
  column_.assign(column.begin(), column.end());
}

Rows PoreFlow::assemble(const Conditions& conditions, double dt, double reference) {
  const Mesh& mesh = network_.mesh();
  const std::size_t n = network_.pores();
  const PoreExchange& exchange = network_.exchange();
  std::vector<double> pressure(conditions.pressure, conditions.pressure + n);
  exchange.fetch(pressure.data());
  Rows rows(free_.size(), first_row_);
  const auto own = static_cast<PetscInt>(free_.size());
  int ranks = 1;
  MPI_Comm_size(comm_, &ranks);
  std::vector<std::vector<RemoteSide>> remote(ranks);
  for (std::size_t t = 0; t < throats_.facet.size(); ++t) {
    const double c = throats_.conductance[t];
    if (c == 0.0) continue;
    const std::int32_t left = mesh.facet.left[throats_.facet[t]], right = mesh.facet.right[throats_.facet[t]];
    const auto add = [&](std::int32_t pore, std::int32_t other, double head) {
      if (column_[pore] < 0) return;
      const PetscInt row = column_[pore] - first_row_;
      if (row >= 0 && row < own) rows.couple(row, c, head, column_[other], pressure[other], reference);
      else remote[exchange.owner_rank(pore)].push_back({column_[pore], column_[other], c, head, pressure[other]});
    };
    const double head = throats_.head_of(t);
    add(left, right, head);
    add(right, left, -head);
  }
  if (ranks > 1)
    for (const RemoteSide& s : deliver(comm_, remote))
      rows.couple(s.row - first_row_, s.conductance, s.head, s.column, s.pressure, reference);
  for (std::size_t k = 0; k < free_.size(); ++k) {
    const std::int32_t c = free_[k];
    rows.right[k] += conditions.source[c] - conditions.volume_rate[c];
    rows.terms[k] += std::abs(conditions.source[c]) + std::abs(conditions.volume_rate[c]);
    if (dt > 0.0) {
      rows.diagonal(k) += storage_[c] / dt;
      rows.right[k] += storage_[c] / dt * (pressure[c] - reference);
      rows.terms[k] += storage_[c] / dt * std::abs(pressure[c]);
    }
  }
  return rows;
}

}  // namespace poreslip::flow
