// Numbering of the unknowns and assembly of their equations, (7) and (10)-(13).
#include <algorithm>
#include <cmath>
#include <numeric>

#include "flow/parts.hpp"
#include "flow/pore_flow.hpp"
#include "flow/rows.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip::flow {
namespace {

// What a throat does in one solve to a pore that its own rank does not own.
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

// Numbers the pores whose pressure is not given, rank by rank, along the Hilbert curve, unless they are those of the call before.
void PoreFlow::number(const bool* fixed, bool stored) {
  const std::size_t n = network_.pores();
  std::vector<std::uint8_t> given(fixed, fixed + n);
  network_.exchange().fetch(given.data());
  // Without storage what is cut off depends on the conductances.
  const bool other = numbered_mesh_ != network_.mesh_number() || given != given_ || stored != numbered_stored_ || (!stored && !numbered_throats_);
  if (!any_rank(comm_, other)) return;
  const std::vector<std::uint8_t> fixed_before = std::move(fixed_);
  const bool same_mesh = numbered_mesh_ == network_.mesh_number();
  numbered_mesh_ = -1;
  given_ = std::move(given);
  fixed_ = given_;
  sealed_ = !any_rank(comm_, std::find(given_.begin(), given_.end(), 1) != given_.end());
  cut_off_ = 0;
  if (!stored) look_for_parts();
  numbered_mesh_ = network_.mesh_number();
  numbered_stored_ = stored;
  numbered_throats_ = true;
  if (!any_rank(comm_, !same_mesh || fixed_ != fixed_before)) return;
  structured_ = false;
  free_.clear();
  for (std::size_t c = 0; c < n; ++c)
    if (network_.owned()[c] && fixed_[c] == 0) free_.push_back(static_cast<std::int32_t>(c));
  std::int64_t count = static_cast<std::int64_t>(free_.size()), before = 0;
  MPI_Exscan(&count, &before, 1, MPI_INT64_T, MPI_SUM, comm_);
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  if (rank == 0) before = 0;
  first_row_ = static_cast<PetscInt>(before);
  all_rows_ = static_cast<PetscInt>(sum(comm_, count));
  column_.assign(n, -1);
  for (std::size_t k = 0; k < free_.size(); ++k) column_[free_[k]] = static_cast<PetscInt>(before + k);
  network_.exchange().fetch(column_.data());
}

// Pores that no chain of open throats joins to a given pressure keep their own: without storage nothing determines it. Where no pressure is given at
// all, those without any open throat do, and all others must be of one part.
void PoreFlow::look_for_parts() {
  const std::vector<double>& c = throats_.conductance;
  bool shut = false;
  for (std::size_t f = 0; f < c.size() && !shut; ++f) shut = c[f] == 0.0 && throats_.owned[f];
  if (!any_rank(comm_, shut)) return;
  const std::vector<std::int64_t> part = connected_parts(network_, throats_);
  if (!sealed_) {
    cut_off_ = fix_cut_off(network_, part, fixed_);
    return;
  }
  cut_off_ = fix_isolated(network_, throats_, fixed_);
  refuse_several(network_, part, fixed_);
}

// Throats between pores of which this rank owns the throat but not the pore, and the other way round.
void PoreFlow::find_remote() {
  const Mesh& mesh = network_.mesh();
  int ranks = 1;
  MPI_Comm_size(comm_, &ranks);
  outgoing_.assign(ranks, {});
  incoming_.clear();
  incoming_by_row_.clear();
  if (network_.halo().grains().empty() && ranks == 1) return;
  std::vector<std::vector<RemotePlace>> remote(ranks);
  for (std::size_t f = 0; f < mesh.facets(); ++f) {
    if (!throats_.owned[f]) continue;
    const std::int32_t pore[2] = {mesh.facet.left[f], mesh.facet.right[f]};
    for (int side = 0; side < 2; ++side) {
      if (mesh.owned[pore[side]] || column_[pore[side]] < 0) continue;
      const int owner = network_.exchange().owner_rank(pore[side]);
      remote[owner].push_back({column_[pore[side]], column_[pore[1 - side]]});
      outgoing_[owner].push_back(static_cast<std::int64_t>(2 * f) + side);
    }
  }
  incoming_ = deliver(comm_, remote);
  incoming_by_row_.resize(incoming_.size());
  std::iota(incoming_by_row_.begin(), incoming_by_row_.end(), 0);
  std::stable_sort(incoming_by_row_.begin(), incoming_by_row_.end(), [this](std::int32_t a, std::int32_t b) { return incoming_[a].row < incoming_[b].row; });
}

// Calls visit(facet, pore on the other side, whether this one is on the left) for the throats of an own pore that this rank owns.
template <class Visit>
void PoreFlow::for_each_side(std::int32_t pore, Visit visit) const {
  const Mesh& mesh = network_.mesh();
  for (int k = 0; k < 4; ++k) {
    const std::int32_t f = mesh.cell_facet[k][pore];
    if (f < 0 || static_cast<std::size_t>(f) >= mesh.facets() || !throats_.owned[f]) continue;
    const bool left = mesh.facet.left[f] == pore;
    visit(f, left ? mesh.facet.right[f] : mesh.facet.left[f], left);
  }
}

// Right sides for pressures less a reference, and the entries, or their values, if they are to be made anew. pressure (pores): before, at copies too.
PoreFlow::Sums PoreFlow::assemble(const Conditions& conditions, const double* pressure, double dt, double reference, bool columns, bool values) {
  const auto rows = static_cast<PetscInt>(free_.size());
  std::vector<RemoteSide> received;
  if (columns) find_remote();
  if (outgoing_.size() > 1 || !outgoing_[0].empty()) {
    const Mesh& mesh = network_.mesh();
    std::vector<std::vector<RemoteSide>> remote(outgoing_.size());
    for (std::size_t r = 0; r < remote.size(); ++r)
      for (const std::int64_t place : outgoing_[r]) {
        const std::int64_t f = place / 2;
        const bool left = place % 2 == 0;
        const double head = throats_.head_of(f);
        remote[r].push_back({throats_.conductance[f], left ? head : -head, pressure[left ? mesh.facet.right[f] : mesh.facet.left[f]]});
      }
    received = deliver(comm_, remote);
  }
  const bool weightless = throats_.head.empty();
  Entries& entries = solver_.entries();
  EntryWriter writer(entries, rows, first_row_, columns);
  PetscScalar* const right = solver_.right();
  Sums sums;
  if (values) {
    edges_.clear();
    isolated_.clear();
    matrix_sum_ = 0.0;
  }
  std::size_t next = 0;
  auto edge = edges_.begin();
  for (PetscInt k = 0; k < rows; ++k) {
    const std::int32_t c = free_[k];
    const double stored = dt > 0.0 ? storage_[c] / dt : 0.0, deviation = pressure[c] - reference;
    Row row;
    row.diagonal = stored;
    row.right = conditions.source[c] - conditions.volume_rate[c] + stored * deviation;
    row.terms = std::abs(conditions.source[c]) + std::abs(conditions.volume_rate[c]) + stored * std::abs(pressure[c]);
    const std::size_t first = next;
    while (next < incoming_.size() && incoming_[incoming_by_row_[next]].row == first_row_ + k) ++next;
    const bool beside = !values && edge != edges_.end() && edge->row == k;
    if (beside) ++edge;
    if (values || beside || !weightless) {
      for_each_side(c, [&](std::int32_t f, std::int32_t other, bool left) {
        const double head = throats_.head_of(f);
        row.add(column_[other], throats_.conductance[f], left ? head : -head, pressure[other], reference);
      });
      for (std::size_t i = first; i < next; ++i) {
        const RemoteSide& side = received[incoming_by_row_[i]];
        row.add(incoming_[incoming_by_row_[i]].other, side.conductance, side.head, side.pressure, reference);
      }
    }
    if (values) {
      row.drop(first_row_ + k);
      if (row.given > 0.0) edges_.push_back({k, row.given});
      matrix_sum_ += stored + row.given;
      if (row.diagonal == 0.0) {
        isolated_.push_back(k);
        row.diagonal = 1.0;
      }
      writer.write(row);
    } else {
      row.diagonal = entries.value[entries.diagonal(k)];
    }
    right[k] = row.right;
    const double scale = row.terms + row.diagonal * std::max(std::abs(conditions.pressure[c]), std::abs(reference));
    sums.right += row.right;
    sums.terms += row.terms;
    sums.squares += scale * scale;
  }
  // A pore without any open throat, where nothing is stored and no pressure is given, keeps its own.
  for (const PetscInt k : isolated_) right[k] = pressure[free_[k]] - reference;
  return sums;
}

}  // namespace poreslip::flow
