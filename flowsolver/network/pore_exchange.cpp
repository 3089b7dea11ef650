#include "network/pore_exchange.hpp"

#include <algorithm>
#include <unordered_map>

#include "network/cell_key.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip {
namespace {

MPI_Datatype mpi_type(double) { return MPI_DOUBLE; }
MPI_Datatype mpi_type(std::int32_t) { return MPI_INT32_T; }
MPI_Datatype mpi_type(std::int64_t) { return MPI_INT64_T; }
MPI_Datatype mpi_type(std::uint8_t) { return MPI_UINT8_T; }

std::vector<int> starts(const std::vector<int>& count) {
  std::vector<int> start(count.size(), 0);
  for (std::size_t r = 1; r < count.size(); ++r) start[r] = start[r - 1] + count[r - 1];
  return start;
}

}  // namespace

void PoreExchange::build(MPI_Comm comm, const Mesh& mesh, const LocalGrains& grains, const Halo& halo) {
  comm_ = comm;
  int rank = 0, ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  const std::size_t n = mesh.cells();
  owner_rank_.assign(n, rank);
  owner_index_.resize(n);
  copy_count_.assign(ranks, 0);
  for (std::size_t c = 0; c < n; ++c) {
    owner_index_[c] = static_cast<std::int32_t>(c);
    if (mesh.owned[c]) continue;
    const std::array<Vertex, 4> v = mesh.vertices(c);
    owner_rank_[c] = halo.grains()[-1 - grains.source[leading_vertex(v.data(), 4, grains)]].rank;
    ++copy_count_[owner_rank_[c]];
  }
  copy_start_ = starts(copy_count_);
  std::size_t copies = 0;
  for (const int count : copy_count_) copies += count;
  alone_ = !any_rank(comm, copies > 0);
  if (alone_) return;

  copy_.resize(copies);
  std::vector<int> next = copy_start_;
  for (std::size_t c = 0; c < n; ++c)
    if (!mesh.owned[c]) copy_[next[owner_rank_[c]]++] = static_cast<std::int32_t>(c);
  std::vector<CellKey> wanted(copies);
  for (std::size_t k = 0; k < copies; ++k) wanted[k] = cell_key(mesh.vertices(copy_[k]), grains);

  source_count_.assign(ranks, 0);
  MPI_Alltoall(copy_count_.data(), 1, MPI_INT, source_count_.data(), 1, MPI_INT, comm);
  source_start_ = starts(source_count_);
  std::vector<CellKey> asked(source_start_.back() + source_count_.back());
  MPI_Datatype type;
  MPI_Type_contiguous(sizeof(CellKey), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  MPI_Alltoallv(wanted.data(), copy_count_.data(), copy_start_.data(), type, asked.data(), source_count_.data(),
                source_start_.data(), type, comm);
  MPI_Type_free(&type);

  std::unordered_map<CellKey, std::int32_t, CellKeyHash> sought;
  sought.reserve(asked.size());
  for (const CellKey& key : asked) sought.emplace(key, -1);
  for (std::size_t c = 0; c < n && !asked.empty(); ++c) {
    const std::array<Vertex, 4> v = mesh.vertices(c);
    // Others see no cell but those that have a grain of theirs.
    if (!mesh.owned[c] || std::all_of(v.begin(), v.end(), [&](Vertex g) { return is_wall(g) || grains.own(g); })) continue;
    if (const auto place = sought.find(cell_key(v, grains)); place != sought.end())
      place->second = static_cast<std::int32_t>(c);
  }
  source_.resize(asked.size());
  std::string fault;
  for (std::size_t k = 0; k < asked.size(); ++k) {
    source_[k] = sought.at(asked[k]);
    if (source_[k] < 0)
      fault = "two copies of the mesh differ at the cell that has grain " +
              std::to_string(std::max_element(asked[k].item.begin(), asked[k].item.end())->id) +
              ": grains there are cospherical, with a wall or among themselves; move one, or the wall, by a hundred-thousandth of the box";
  }
  agree_on_computation(comm, fault);
  std::vector<std::int32_t> found(copies);
  MPI_Alltoallv(source_.data(), source_count_.data(), source_start_.data(), MPI_INT32_T, found.data(), copy_count_.data(),
                copy_start_.data(), MPI_INT32_T, comm);
  for (std::size_t k = 0; k < copies; ++k) owner_index_[copy_[k]] = found[k];
}

template <class Value>
void PoreExchange::fetch(Value* value) const {
  if (alone_) return;
  std::vector<Value> sent(source_.size()), received(copy_.size());
  for (std::size_t k = 0; k < source_.size(); ++k) sent[k] = value[source_[k]];
  const MPI_Datatype type = mpi_type(Value{});
  MPI_Alltoallv(sent.data(), source_count_.data(), source_start_.data(), type, received.data(), copy_count_.data(), copy_start_.data(), type, comm_);
  for (std::size_t k = 0; k < copy_.size(); ++k) value[copy_[k]] = received[k];
}

template void PoreExchange::fetch(double*) const;
template void PoreExchange::fetch(std::int32_t*) const;
template void PoreExchange::fetch(std::int64_t*) const;
template void PoreExchange::fetch(std::uint8_t*) const;

void PoreExchange::add_to_owner(double* value) const {
  if (alone_) return;
  std::vector<double> sent(copy_.size()), received(source_.size());
  for (std::size_t k = 0; k < copy_.size(); ++k) sent[k] = value[copy_[k]];
  MPI_Alltoallv(sent.data(), copy_count_.data(), copy_start_.data(), MPI_DOUBLE, received.data(), source_count_.data(),
                source_start_.data(), MPI_DOUBLE, comm_);
  for (std::size_t k = 0; k < source_.size(); ++k) value[source_[k]] += received[k];
}

}  // namespace poreslip
