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

// A side of a throat whose pore another rank owns: which unknowns it joins, and what it does in one solve.
struct RemotePlace {
  PetscInt row, column;  // global numbers of the pore and of the one on the other side, -1 if its pressure is given
};
struct RemoteSide {
  double conductance;    // C / l
  double head;           // gain of the body force from that pore to the other
  double pressure;       // of the other pore
};

template <class Item>
std::vector<Item> deliver(MPI_Comm comm, const std::vector<std::vector<Item>>& out) {
  const int ranks = static_cast<int>(out.size());
  std::vector<int> count(ranks), start(ranks, 0), received_count(ranks), received_start(ranks, 0);
  std::vector<Item> sent;
  for (int r = 0; r < ranks; ++r) {
    start[r] = static_cast<int>(sent.size());
    count[r] = static_cast<int>(out[r].size());
    sent.insert(sent.end(), out[r].begin(), out[r].end());
  }
  MPI_Alltoall(count.data(), 1, MPI_INT, received_count.data(), 1, MPI_INT, comm);
  for (int r = 1; r < ranks; ++r) received_start[r] = received_start[r - 1] + received_count[r - 1];
  std::vector<Item> received(received_start.back() + received_count.back());
  MPI_Datatype type;
  MPI_Type_contiguous(sizeof(Item), MPI_BYTE, &type);
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

// Numbers the pores whose pressure is not given, rank by rank, along the Hilbert curve, unless they are those of the call before.
void PoreFlow::number(const bool* fixed, bool stored) {
  const std::size_t n = network_.pores();
  std::vector<double> given(n);
  for (std::size_t c = 0; c < n; ++c) given[c] = fixed[c] ? 1.0 : 0.0;
  network_.exchange().fetch(given.data());
  // Without storage what is cut off depends on the conductances.
  const bool other = numbered_mesh_ != network_.mesh_number() || given != given_ || stored != numbered_stored_ || (!stored && !numbered_throats_);
  if (!any_rank(comm_, other)) return;
  const std::vector<double> fixed_before = std::move(fixed_);
  const bool same_mesh = numbered_mesh_ == network_.mesh_number();
  numbered_mesh_ = network_.mesh_number();
  numbered_stored_ = stored;
  numbered_throats_ = true;
  given_ = std::move(given);
  fixed_ = given_;
  cut_off_ = 0;
  if (!stored) fix_cut_off();
  if (!any_rank(comm_, !same_mesh || fixed_ != fixed_before)) return;
  entries_found_ = false;
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

// Which entries the equations have, and where each throat stands among them.
Entries PoreFlow::find_entries() {
  const Mesh& mesh = network_.mesh();
  int ranks = 1;
  MPI_Comm_size(comm_, &ranks);
  EntryCollector collector(free_.size(), first_row_);
  sides_.assign(throats_.facet.size(), {});
  outgoing_.assign(ranks, {});
  std::vector<std::vector<RemotePlace>> remote(ranks);
  for (std::size_t t = 0; t < throats_.facet.size(); ++t) {
    const std::int32_t pore[2] = {mesh.facet.left[throats_.facet[t]], mesh.facet.right[throats_.facet[t]]};
    for (int side = 0; side < 2; ++side) {
      const PetscInt row = column_[pore[side]], other = column_[pore[1 - side]];
      if (row < 0) continue;
      if (collector.owns(row)) {
        sides_[t][side] = collector.add(row, other);
      } else {
        const int owner = network_.exchange().owner_rank(pore[side]);
        remote[owner].push_back({row, other});
        outgoing_[owner].push_back(static_cast<std::int32_t>(2 * t) + side);
      }
    }
  }
  incoming_.clear();
  if (ranks > 1)
    for (const RemotePlace& place : deliver(comm_, remote)) incoming_.push_back(collector.add(place.row, place.column));
  Entries entries = collector.entries();
  for (auto& both : sides_)
    for (Side& side : both) side = collector.placed(side);
  for (Side& side : incoming_) side = collector.placed(side);
  return entries;
}

// Right sides for pressures less a reference, and the entries' values if they are to be made anew.
PoreFlow::RightSides PoreFlow::assemble(const Conditions& conditions, double dt, double reference, Entries& entries, bool anew) {
  const Mesh& mesh = network_.mesh();
  const std::size_t n = network_.pores();
  std::vector<double> pressure(conditions.pressure, conditions.pressure + n);
  network_.exchange().fetch(pressure.data());
  RightSides right{std::vector<double>(free_.size()), std::vector<double>(free_.size())};
  std::vector<PetscScalar>& value = entries.value;
  if (anew) std::fill(value.begin(), value.end(), 0.0);
  for (std::size_t k = 0; k < free_.size(); ++k) {
    const std::int32_t c = free_[k];
    right.value[k] = conditions.source[c] - conditions.volume_rate[c];
    right.terms[k] = std::abs(conditions.source[c]) + std::abs(conditions.volume_rate[c]);
    if (dt > 0.0) {
      const double stored = storage_[c] / dt;
      right.value[k] += stored * (pressure[c] - reference);
      right.terms[k] += stored * std::abs(pressure[c]);
      if (anew) value[entries.diagonal[k]] = stored;
    }
  }
  const auto couple = [&](const Side& side, const RemoteSide& throat) {
    if (anew) {
      value[entries.diagonal[side.row]] += throat.conductance;
      if (side.other >= 0) value[side.other] -= throat.conductance;
    }
    // Flow out of the pore is conductance * (p - p_other + head).
    right.value[side.row] -= throat.conductance * throat.head;
    right.terms[side.row] += throat.conductance * std::abs(throat.head);
    if (side.other < 0) {
      right.value[side.row] += throat.conductance * (throat.pressure - reference);
      right.terms[side.row] += throat.conductance * std::abs(throat.pressure);
    }
  };
  const auto side_of = [&](std::size_t t, int side) {
    const std::int32_t other = side == 0 ? mesh.facet.right[throats_.facet[t]] : mesh.facet.left[throats_.facet[t]];
    const double head = throats_.head_of(t);
    return RemoteSide{throats_.conductance[t], side == 0 ? head : -head, pressure[other]};
  };
  const bool weightless = throats_.head.empty();
  for (std::size_t t = 0; t < sides_.size(); ++t)
    for (int side = 0; side < 2; ++side)
      if (const Side& s = sides_[t][side]; s.row >= 0 && (anew || s.other < 0 || !weightless)) couple(s, side_of(t, side));
  if (outgoing_.size() > 1) {
    std::vector<std::vector<RemoteSide>> remote(outgoing_.size());
    for (std::size_t r = 0; r < remote.size(); ++r)
      for (const std::int32_t place : outgoing_[r]) remote[r].push_back(side_of(place / 2, place % 2));
    const std::vector<RemoteSide> received = deliver(comm_, remote);
    for (std::size_t k = 0; k < received.size(); ++k) couple(incoming_[k], received[k]);
  }
  return right;
}

}  // namespace poreslip::flow
