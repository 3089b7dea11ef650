#include "tessellation/halo.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tessellation/exchange.hpp"

namespace poreslip {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

struct Bounds {
  double lower[3] = {infinity, infinity, infinity};
  double upper[3] = {-infinity, -infinity, -infinity};
  bool empty() const { return lower[0] > upper[0]; }
};

Bounds bounds_of(const OwnGrains& own) {
  Bounds b;
  const std::vector<double>* coordinate[3] = {&own.x, &own.y, &own.z};
  for (int d = 0; d < 3; ++d)
    for (const double v : *coordinate[d]) {
      b.lower[d] = std::min(b.lower[d], v);
      b.upper[d] = std::max(b.upper[d], v);
    }
  return b;
}

}  // namespace

void Halo::build(MPI_Comm comm, const Domain& domain, const std::array<double, 3>& period, const OwnGrains& own,
                 double width) {
  comm_ = comm;
  period_ = period;
  int rank = 0, ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  const Bounds mine = bounds_of(own);
  std::vector<Bounds> all(ranks);
  MPI_Allgather(&mine, sizeof(Bounds), MPI_BYTE, all.data(), sizeof(Bounds), MPI_BYTE, comm);

  send_index_.clear();
  send_shift_.clear();
  send_count_.assign(ranks, 0);
  std::vector<HaloGrain> sent;
  for (int r = 0; r < ranks && !mine.empty(); ++r) {
    if (all[r].empty()) continue;
    // Shifts that can bring any grain of this rank into that rank's surroundings.
    int low[3], high[3];
    for (int d = 0; d < 3; ++d) {
      low[d] = high[d] = 0;
      if (!domain.periodic[d]) continue;
      low[d] = static_cast<int>(std::ceil((all[r].lower[d] - width - mine.upper[d]) / period[d]));
      high[d] = static_cast<int>(std::floor((all[r].upper[d] + width - mine.lower[d]) / period[d]));
    }
    std::array<int, 3> k;
    for (k[0] = low[0]; k[0] <= high[0]; ++k[0])
      for (k[1] = low[1]; k[1] <= high[1]; ++k[1])
        for (k[2] = low[2]; k[2] <= high[2]; ++k[2]) {
          if (r == rank && k == std::array<int, 3>{0, 0, 0}) continue;
          double from[3], to[3];
          for (int d = 0; d < 3; ++d) {
            from[d] = all[r].lower[d] - width - k[d] * period[d];
            to[d] = all[r].upper[d] + width - k[d] * period[d];
          }
          for (std::size_t i = 0; i < own.size(); ++i) {
            if (own.x[i] < from[0] || own.x[i] > to[0] || own.y[i] < from[1] || own.y[i] > to[1] || own.z[i] < from[2] ||
                own.z[i] > to[2])
              continue;
            const std::array<std::int8_t, 3> shift{static_cast<std::int8_t>(k[0]), static_cast<std::int8_t>(k[1]),
                                                   static_cast<std::int8_t>(k[2])};
            sent.push_back({own.x[i] + k[0] * period[0], own.y[i] + k[1] * period[1], own.z[i] + k[2] * period[2],
                            own.radius[i], own.id[i], own.group[i], rank, static_cast<std::int32_t>(i), shift});
            send_index_.push_back(static_cast<std::int32_t>(i));
            send_shift_.push_back(shift);
            ++send_count_[r];
          }
        }
  }
  receive_count_.assign(ranks, 0);
  MPI_Alltoall(send_count_.data(), 1, MPI_INT, receive_count_.data(), 1, MPI_INT, comm);
  grains_ = exchange(comm, sent, send_count_, receive_count_);

  Bounds whole;
  for (const Bounds& b : all)
    for (int d = 0; d < 3; ++d) {
      whole.lower[d] = std::min(whole.lower[d], b.lower[d]);
      whole.upper[d] = std::max(whole.upper[d], b.upper[d]);
    }
  for (int d = 0; d < 3; ++d) {
    known_lower_[d] = mine.lower[d] - width;
    known_upper_[d] = mine.upper[d] + width;
    if (domain.periodic[d]) continue;
    if (known_lower_[d] <= whole.lower[d]) known_lower_[d] = -infinity;
    if (known_upper_[d] >= whole.upper[d]) known_upper_[d] = infinity;
  }
}

void Halo::refresh(const OwnGrains& own) {
  std::vector<std::array<double, 4>> sent(send_index_.size());
  for (std::size_t s = 0; s < sent.size(); ++s) {
    const std::int32_t i = send_index_[s];
    const auto& k = send_shift_[s];
    sent[s] = {own.x[i] + k[0] * period_[0], own.y[i] + k[1] * period_[1], own.z[i] + k[2] * period_[2], own.radius[i]};
  }
  const auto received = exchange(comm_, sent, send_count_, receive_count_);
  for (std::size_t g = 0; g < grains_.size(); ++g) {
    grains_[g].x = received[g][0];
    grains_[g].y = received[g][1];
    grains_[g].z = received[g][2];
    grains_[g].radius = received[g][3];
  }
}

std::vector<std::array<double, 3>> Halo::fetch(const std::vector<std::array<double, 3>>& own) const {
  std::vector<std::array<double, 3>> sent(send_index_.size());
  for (std::size_t s = 0; s < sent.size(); ++s) sent[s] = own[send_index_[s]];
  return exchange(comm_, sent, send_count_, receive_count_);
}

void Halo::add_to_owners(const std::vector<std::array<double, 3>>& halo, std::vector<std::array<double, 3>>& own) const {
  const auto received = exchange(comm_, halo, receive_count_, send_count_);
  for (std::size_t s = 0; s < received.size(); ++s)
    for (int d = 0; d < 3; ++d) own[send_index_[s]][d] += received[s][d];
}

}  // namespace poreslip
