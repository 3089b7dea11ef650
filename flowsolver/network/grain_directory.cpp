#include "network/grain_directory.hpp"

#include <algorithm>
#include <array>

namespace poreslip {
namespace {

// Beyond this share of all grains, sending strays about costs more than a mesh built where they now are.
constexpr std::int64_t rebuild_one_in = 20;

struct Stray {
  std::int64_t id;
  std::array<double, 4> value;
  std::int32_t group;
};

// Collective. The strays of all ranks, on all ranks.
std::vector<Stray> share(MPI_Comm comm, const std::vector<Stray>& mine) {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  const int bytes = static_cast<int>(mine.size() * sizeof(Stray));
  std::vector<int> counts(ranks), starts(ranks, 0);
  MPI_Allgather(&bytes, 1, MPI_INT, counts.data(), 1, MPI_INT, comm);
  for (int r = 1; r < ranks; ++r) starts[r] = starts[r - 1] + counts[r - 1];
  std::vector<Stray> all((starts.back() + counts.back()) / sizeof(Stray));
  MPI_Allgatherv(mine.data(), bytes, MPI_BYTE, all.data(), counts.data(), starts.data(), MPI_BYTE, comm);
  return all;
}

}  // namespace

void GrainDirectory::reset(const std::vector<std::int64_t>& id) {
  by_id_.resize(id.size());
  own_of_input_.resize(id.size());
  for (std::size_t i = 0; i < id.size(); ++i) {
    by_id_[i] = {id[i], static_cast<std::int32_t>(i)};
    own_of_input_[i] = static_cast<std::int32_t>(i);
  }
  std::sort(by_id_.begin(), by_id_.end());
  own_id_ = input_id_ = id;
  lost_.clear();
  strays_everywhere_ = 0;
}

GrainDirectory::Match GrainDirectory::match(MPI_Comm comm, const GrainInput& input) {
  std::int64_t strays = 0;
  if (!std::equal(input_id_.begin(), input_id_.end(), input.id, input.id + input.count)) {
    input_id_.assign(input.id, input.id + input.count);
    own_of_input_.assign(input.count, -1);
    std::vector<bool> found(by_id_.size(), false);
    bool twice = false;
    for (std::size_t i = 0; i < input.count; ++i) {
      const auto place = std::lower_bound(by_id_.begin(), by_id_.end(), std::pair{input.id[i], std::int32_t{-1}});
      if (place == by_id_.end() || place->first != input.id[i]) continue;
      twice = twice || found[place->second];
      found[place->second] = true;
      own_of_input_[i] = place->second;
    }
    lost_.clear();
    for (std::size_t o = 0; o < found.size(); ++o)
      if (!found[o]) lost_.push_back(static_cast<std::int32_t>(o));
    // An id given twice cannot be matched; the rebuild that follows names it.
    if (twice) input_id_.clear();
  }
  for (const std::int32_t o : own_of_input_) strays += o < 0;
  const bool repeated = input_id_.size() != input.count;
  std::array<std::int64_t, 4> total{strays, static_cast<std::int64_t>(lost_.size()),
                                    static_cast<std::int64_t>(input.count), repeated ? 1 : 0};
  MPI_Allreduce(MPI_IN_PLACE, total.data(), 4, MPI_INT64_T, MPI_SUM, comm);
  if (total[3] > 0 || total[0] != total[1]) return Match::other;
  strays_everywhere_ = total[0];
  if (strays_everywhere_ == 0) return Match::same;

  std::vector<Stray> mine;
  for (std::size_t i = 0; i < input.count; ++i)
    if (own_of_input_[i] < 0) mine.push_back({input.id[i], {}, 0});
  std::vector<std::int64_t> ids;
  for (const Stray& s : share(comm, mine)) ids.push_back(s.id);
  std::sort(ids.begin(), ids.end());
  std::vector<std::int64_t> wanted;
  for (const std::int32_t o : lost_) wanted.push_back(own_id_[o]);
  std::sort(wanted.begin(), wanted.end());
  int unknown = std::includes(ids.begin(), ids.end(), wanted.begin(), wanted.end()) ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &unknown, 1, MPI_INT, MPI_SUM, comm);
  if (unknown > 0) return Match::other;
  return strays_everywhere_ * rebuild_one_in > total[2] ? Match::scattered : Match::same;
}

void GrainDirectory::gather(MPI_Comm comm, const GrainInput& input, OwnGrains& own) const {
  const auto put = [&own](std::int32_t o, const double* x, double radius, std::int32_t group) {
    own.x[o] = x[0];
    own.y[o] = x[1];
    own.z[o] = x[2];
    own.radius[o] = radius;
    own.group[o] = group;
  };
  std::vector<Stray> mine;
  for (std::size_t i = 0; i < input.count; ++i) {
    const double* x = input.position + 3 * i;
    const std::int32_t group = input.group ? input.group[i] : 0;
    if (own_of_input_[i] >= 0) put(own_of_input_[i], x, input.radius[i], group);
    else mine.push_back({input.id[i], {x[0], x[1], x[2], input.radius[i]}, group});
  }
  if (strays_everywhere_ == 0) return;
  for (const Stray& s : share(comm, mine)) {
    const auto place = std::lower_bound(by_id_.begin(), by_id_.end(), std::pair{s.id, std::int32_t{-1}});
    if (place != by_id_.end() && place->first == s.id) put(place->second, s.value.data(), s.value[3], s.group);
  }
}

void GrainDirectory::gather_vectors(MPI_Comm comm, const double* vector, std::vector<std::array<double, 3>>& own) const {
  std::vector<Stray> mine;
  for (std::size_t i = 0; i < own_of_input_.size(); ++i) {
    const double* v = vector + 3 * i;
    if (own_of_input_[i] >= 0) own[own_of_input_[i]] = {v[0], v[1], v[2]};
    else mine.push_back({input_id_[i], {v[0], v[1], v[2], 0.0}, 0});
  }
  if (strays_everywhere_ == 0) return;
  for (const Stray& s : share(comm, mine)) {
    const auto place = std::lower_bound(by_id_.begin(), by_id_.end(), std::pair{s.id, std::int32_t{-1}});
    if (place != by_id_.end() && place->first == s.id) own[place->second] = {s.value[0], s.value[1], s.value[2]};
  }
}

void GrainDirectory::scatter(MPI_Comm comm, const std::vector<std::array<double, 3>>& own, double* force) const {
  for (std::size_t i = 0; i < own_of_input_.size(); ++i) {
    const std::int32_t o = own_of_input_[i];
    if (o < 0) continue;
    for (int d = 0; d < 3; ++d) force[3 * i + d] = own[o][d];
  }
  if (strays_everywhere_ == 0) return;
  std::vector<Stray> mine;
  for (const std::int32_t o : lost_) mine.push_back({own_id_[o], {own[o][0], own[o][1], own[o][2], 0.0}, 0});
  std::vector<Stray> all = share(comm, mine);
  const auto by_id = [](const Stray& a, const Stray& b) { return a.id < b.id; };
  std::sort(all.begin(), all.end(), by_id);
  for (std::size_t i = 0; i < own_of_input_.size(); ++i) {
    if (own_of_input_[i] >= 0) continue;
    const auto place = std::lower_bound(all.begin(), all.end(), Stray{input_id_[i], {}, 0}, by_id);
    for (int d = 0; d < 3; ++d) force[3 * i + d] = place->value[d];
  }
}

}  // namespace poreslip
