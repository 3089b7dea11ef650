#include "network/pore_exchange.hpp"

#include <algorithm>
#include <array>
#include <unordered_map>

#include "tessellation/agreement.hpp"

namespace poreslip {
namespace {

// The same on every rank and for every periodic copy: vertices by id and by shift relative to the leading vertex, sorted.
struct Key {
  struct Item {
    std::int64_t id;
    std::array<std::int8_t, 8> shift;
    auto operator<=>(const Item&) const = default;
  };
  std::array<Item, 4> item;
  bool operator==(const Key&) const = default;
};

struct Hash {
  std::size_t operator()(const Key& key) const {
    std::uint64_t h = 0;
    for (const auto& i : key.item) {
      h = (h ^ static_cast<std::uint64_t>(i.id)) * 0x9e3779b97f4a7c15ull;
      h ^= h >> 29;
    }
    return h;
  }
};

Key key_of(const Mesh& mesh, const LocalGrains& grains, std::size_t cell) {
  Vertex v[4];
  for (int k = 0; k < 4; ++k) v[k] = mesh.cell_vertex[k][cell];
  const auto& origin = grains.shift[leading_vertex(v, 4, grains)];
  Key key{};
  for (int k = 0; k < 4; ++k) {
    key.item[k].id = is_wall(v[k]) ? v[k] : grains.id[v[k]];
    if (is_wall(v[k])) continue;
    for (int d = 0; d < 3; ++d) key.item[k].shift[d] = static_cast<std::int8_t>(grains.shift[v[k]][d] - origin[d]);
  }
  std::sort(key.item.begin(), key.item.end());
  return key;
}

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
    const Vertex v[4] = {mesh.cell_vertex[0][c], mesh.cell_vertex[1][c], mesh.cell_vertex[2][c], mesh.cell_vertex[3][c]};
    owner_rank_[c] = halo.grains()[-1 - grains.source[leading_vertex(v, 4, grains)]].rank;
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
  std::vector<Key> wanted(copies);
  for (std::size_t k = 0; k < copies; ++k) wanted[k] = key_of(mesh, grains, copy_[k]);

  source_count_.assign(ranks, 0);
  MPI_Alltoall(copy_count_.data(), 1, MPI_INT, source_count_.data(), 1, MPI_INT, comm);
  source_start_ = starts(source_count_);
  std::vector<Key> asked(source_start_.back() + source_count_.back());
  MPI_Datatype type;
  MPI_Type_contiguous(sizeof(Key), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  MPI_Alltoallv(wanted.data(), copy_count_.data(), copy_start_.data(), type, asked.data(), source_count_.data(),
                source_start_.data(), type, comm);
  MPI_Type_free(&type);

  std::unordered_map<Key, std::int32_t, Hash> sought;
  sought.reserve(asked.size());
  for (const Key& key : asked) sought.emplace(key, -1);
  for (std::size_t c = 0; c < n && !asked.empty(); ++c) {
    if (!mesh.owned[c]) continue;
    if (const auto place = sought.find(key_of(mesh, grains, c)); place != sought.end())
      place->second = static_cast<std::int32_t>(c);
  }
  source_.resize(asked.size());
  std::string fault;
  for (std::size_t k = 0; k < asked.size(); ++k) {
    source_[k] = sought.at(asked[k]);
    if (source_[k] < 0)
      fault = "two copies of the mesh differ at the cell that has grain " +
              std::to_string(std::max_element(asked[k].item.begin(), asked[k].item.end())->id) +
              ": grains there are cospherical to the last digit; move one by a billionth of its radius";
  }
  agree_on_computation(comm, fault);
  std::vector<std::int32_t> found(copies);
  MPI_Alltoallv(source_.data(), source_count_.data(), source_start_.data(), MPI_INT32_T, found.data(), copy_count_.data(),
                copy_start_.data(), MPI_INT32_T, comm);
  for (std::size_t k = 0; k < copies; ++k) owner_index_[copy_[k]] = found[k];
}

void PoreExchange::fetch(double* value) const {
  if (alone_) return;
  std::vector<double> sent(source_.size()), received(copy_.size());
  for (std::size_t k = 0; k < source_.size(); ++k) sent[k] = value[source_[k]];
  MPI_Alltoallv(sent.data(), source_count_.data(), source_start_.data(), MPI_DOUBLE, received.data(), copy_count_.data(),
                copy_start_.data(), MPI_DOUBLE, comm_);
  for (std::size_t k = 0; k < copy_.size(); ++k) value[copy_[k]] = received[k];
}

void PoreExchange::add_to_owner(double* value) const {
  if (alone_) return;
  std::vector<double> sent(copy_.size()), received(source_.size());
  for (std::size_t k = 0; k < copy_.size(); ++k) sent[k] = value[copy_[k]];
  MPI_Alltoallv(sent.data(), copy_count_.data(), copy_start_.data(), MPI_DOUBLE, received.data(), source_count_.data(),
                source_start_.data(), MPI_DOUBLE, comm_);
  for (std::size_t k = 0; k < source_.size(); ++k) value[source_[k]] += received[k];
}

}  // namespace poreslip
