#include "network/grain_directory.hpp"

#include <algorithm>
#include <array>
#include <numeric>

#include "tessellation/agreement.hpp"
#include "tessellation/exchange.hpp"

namespace poreslip {
namespace {

// Beyond this share of all grains, sending strays about costs more than a mesh built where they now are.
constexpr std::int64_t rebuild_one_in = 20;

struct Stray {
  std::array<double, 4> value;
  std::int32_t group;
};

// Some ids, and what the rank that each one's value names has to say about it.
class Inquiry {
 public:
  struct Asked {
    std::int64_t id;
    std::int32_t rank, place;  // who asks, and its place among all that were received
  };

  // Collective.
  Inquiry(MPI_Comm comm, const std::vector<std::int64_t>& id) : comm_(comm), place_(id.size()) {
    int ranks = 1;
    MPI_Comm_size(comm, &ranks);
    const auto home = [ranks](std::int64_t v) { return static_cast<std::size_t>(v % ranks); };
    send_count_.assign(ranks, 0);
    for (const std::int64_t v : id) ++send_count_[home(v)];
    std::iota(place_.begin(), place_.end(), 0);
    std::stable_sort(place_.begin(), place_.end(), [&](std::int32_t a, std::int32_t b) { return home(id[a]) < home(id[b]); });
    std::vector<std::int64_t> sent(id.size());
    for (std::size_t k = 0; k < sent.size(); ++k) sent[k] = id[place_[k]];
    receive_count_ = exchange_counts(comm, send_count_);
    const auto received = exchange(comm, sent, send_count_, receive_count_);
    std::int32_t k = 0;
    for (int rank = 0; rank < ranks; ++rank)
      for (int n = 0; n < receive_count_[rank]; ++n, ++k) asked_.push_back({received[k], rank, k});
    std::sort(asked_.begin(), asked_.end(), [](const Asked& a, const Asked& b) { return a.id < b.id; });
  }

  // What this rank was asked about, in the order of the ids.
  const std::vector<Asked>& asked() const { return asked_; }

  // Collective. answer: to each that was asked, by its place. The answers to this rank's own ids, in their order.
  std::vector<std::int32_t> answered(const std::vector<std::int32_t>& answer) const {
    const auto received = exchange(comm_, answer, receive_count_, send_count_);
    std::vector<std::int32_t> own(received.size());
    for (std::size_t k = 0; k < own.size(); ++k) own[place_[k]] = received[k];
    return own;
  }

 private:
  MPI_Comm comm_;
  std::vector<std::int32_t> place_;  // of each id that was sent
  std::vector<int> send_count_, receive_count_;
  std::vector<Asked> asked_;
};

// Puts grains with these ids in the order of the ranks, and of the ids of each; the number of each rank's.
std::vector<int> sort_by_rank(MPI_Comm comm, const std::vector<std::int64_t>& id, const std::vector<std::int32_t>& rank, std::vector<std::int32_t>& grain) {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  std::vector<int> count(ranks, 0);
  std::vector<std::array<std::int64_t, 3>> key(grain.size());
  for (std::size_t k = 0; k < grain.size(); ++k) {
    key[k] = {rank[k], id[k], grain[k]};
    ++count[rank[k]];
  }
  std::sort(key.begin(), key.end());
  for (std::size_t k = 0; k < grain.size(); ++k) grain[k] = static_cast<std::int32_t>(key[k][2]);
  return count;
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
  away_.clear();
  lost_.clear();
  any_strays_ = false;
}

// Where the strays are. False on all ranks if those that one side misses are not those that the other side has too many.
bool GrainDirectory::route(MPI_Comm comm) {
  std::vector<std::int64_t> away_id, lost_id;
  for (const std::int32_t i : away_) away_id.push_back(input_id_[i]);
  for (const std::int32_t o : lost_) lost_id.push_back(own_id_[o]);
  const Inquiry away(comm, away_id), lost(comm, lost_id);
  const auto &here = away.asked(), &there = lost.asked();
  const bool same = std::equal(here.begin(), here.end(), there.begin(), there.end(), [](const auto& a, const auto& b) { return a.id == b.id; });
  if (any_rank(comm, !same)) return false;
  std::vector<std::int32_t> mesh_rank(here.size()), input_rank(there.size());
  for (std::size_t k = 0; k < here.size(); ++k) {
    mesh_rank[here[k].place] = there[k].rank;
    input_rank[there[k].place] = here[k].rank;
  }
  away_count_ = sort_by_rank(comm, away_id, away.answered(mesh_rank), away_);
  lost_count_ = sort_by_rank(comm, lost_id, lost.answered(input_rank), lost_);
  return true;
}

GrainDirectory::Match GrainDirectory::match(MPI_Comm comm, const GrainInput& input) {
  const bool changed = !std::equal(input_id_.begin(), input_id_.end(), input.id, input.id + input.count);
  if (changed) {
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
    away_.clear();
    for (std::size_t i = 0; i < input.count; ++i)
      if (own_of_input_[i] < 0) away_.push_back(static_cast<std::int32_t>(i));
    lost_.clear();
    for (std::size_t o = 0; o < found.size(); ++o)
      if (!found[o]) lost_.push_back(static_cast<std::int32_t>(o));
    // An id given twice cannot be matched; the rebuild that follows names it.
    if (twice) input_id_.clear();
  }
  const bool repeated = input_id_.size() != input.count;
  std::array<std::int64_t, 5> total{static_cast<std::int64_t>(away_.size()), static_cast<std::int64_t>(lost_.size()),
                                    static_cast<std::int64_t>(input.count), repeated ? 1 : 0, changed ? 1 : 0};
  MPI_Allreduce(MPI_IN_PLACE, total.data(), 5, MPI_INT64_T, MPI_SUM, comm);
  if (total[3] > 0 || total[0] != total[1]) return Match::other;
  any_strays_ = total[0] > 0;
  if (!any_strays_) return Match::same;
  if (total[4] > 0 && !route(comm)) {
    // The next call is to look again.
    input_id_.clear();
    return Match::other;
  }
  return total[0] * rebuild_one_in > total[2] ? Match::scattered : Match::same;
}

void GrainDirectory::gather(MPI_Comm comm, const GrainInput& input, OwnGrains& own) const {
  const auto put = [&own](std::int32_t o, const double* x, double radius, std::int32_t group) {
    own.x[o] = x[0];
    own.y[o] = x[1];
    own.z[o] = x[2];
    own.radius[o] = radius;
    own.group[o] = group;
  };
  const auto group_of = [&input](std::size_t i) { return input.group ? input.group[i] : 0; };
  for (std::size_t i = 0; i < input.count; ++i)
    if (own_of_input_[i] >= 0) put(own_of_input_[i], input.position + 3 * i, input.radius[i], group_of(i));
  if (!any_strays_) return;
  std::vector<Stray> sent;
  for (const std::int32_t i : away_) {
    const double* x = input.position + 3 * std::size_t(i);
    sent.push_back({{x[0], x[1], x[2], input.radius[i]}, group_of(i)});
  }
  const auto received = exchange(comm, sent, away_count_, lost_count_);
  for (std::size_t k = 0; k < received.size(); ++k) put(lost_[k], received[k].value.data(), received[k].value[3], received[k].group);
}

void GrainDirectory::gather_vectors(MPI_Comm comm, const double* vector, std::vector<std::array<double, 3>>& own) const {
  const auto at = [vector](std::size_t i) { return std::array{vector[3 * i], vector[3 * i + 1], vector[3 * i + 2]}; };
  for (std::size_t i = 0; i < own_of_input_.size(); ++i)
    if (own_of_input_[i] >= 0) own[own_of_input_[i]] = at(i);
  if (!any_strays_) return;
  std::vector<std::array<double, 3>> sent;
  for (const std::int32_t i : away_) sent.push_back(at(i));
  const auto received = exchange(comm, sent, away_count_, lost_count_);
  for (std::size_t k = 0; k < received.size(); ++k) own[lost_[k]] = received[k];
}

void GrainDirectory::scatter(MPI_Comm comm, const std::vector<std::array<double, 3>>& own, double* force) const {
  const auto put = [force](std::size_t i, const std::array<double, 3>& f) { std::copy_n(f.begin(), 3, force + 3 * i); };
  for (std::size_t i = 0; i < own_of_input_.size(); ++i)
    if (own_of_input_[i] >= 0) put(i, own[own_of_input_[i]]);
  if (!any_strays_) return;
  std::vector<std::array<double, 3>> sent;
  for (const std::int32_t o : lost_) sent.push_back(own[o]);
  const auto received = exchange(comm, sent, lost_count_, away_count_);
  for (std::size_t k = 0; k < received.size(); ++k) put(away_[k], received[k]);
}

}  // namespace poreslip
