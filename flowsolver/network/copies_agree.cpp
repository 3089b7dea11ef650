#include "network/copies_agree.hpp"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "network/cell_key.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip {
namespace {

using Shift = std::array<std::int8_t, 3>;

// Sums of the changed cells' hashes: two, for a chance of 2^-128 that different changes look the same.
using Sums = std::array<std::uint64_t, 2>;

// A copy's hash as seen from one image: the cell, and by which periods it sees the other image displaced.
Sums hash(const CellKey& key, const Shift& shift) {
  Sums sums{1, 2};
  for (auto& h : sums) {
    const auto mix_shift = [&h](const auto& s) {
      for (int d = 0; d < 3; ++d) h = mixed(h, static_cast<std::uint8_t>(s[d]));
    };
    for (const auto& i : key.item) {
      h = mixed(h, static_cast<std::uint64_t>(i.id));
      mix_shift(i.shift);
    }
    mix_shift(shift);
  }
  return sums;
}

}  // namespace

bool copies_agree(MPI_Comm comm, bool found, const Flips& flips, const Mesh& mesh, const LocalGrains& grains, const Halo& halo) {
  int rank = 0, ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  // What this rank has changed of the cells that it shares with each, and what that one should say it has.
  std::vector<Sums> mine(ranks, Sums{}), expected(ranks, Sums{}), theirs(ranks, Sums{});
  const auto count = [&](const std::array<Vertex, 4>& v, std::uint64_t times) {
    if (!touches_own(v.data(), 4, grains)) return;
    std::array<std::pair<std::int32_t, Shift>, 4> seen;
    auto last = seen.begin();
    for (const Vertex g : v) {
      if (is_wall(g) || grains.own(g)) continue;
      const std::pair other{halo.grains()[-1 - grains.source[g]].rank, grains.shift[g]};
      if (std::find(seen.begin(), last, other) == last) *last++ = other;
    }
    if (last == seen.begin()) return;
    const CellKey key = cell_key(v, grains);
    for (auto other = seen.begin(); other != last; ++other) {
      const auto& [owner, s] = *other;
      const Shift back{static_cast<std::int8_t>(-s[0]), static_cast<std::int8_t>(-s[1]), static_cast<std::int8_t>(-s[2])};
      const Sums here = hash(key, s), there = hash(key, back);
      for (int k = 0; k < 2; ++k) {
        mine[owner][k] += times * here[k];
        expected[owner][k] += times * there[k];
      }
    }
  };
  for (const std::int32_t c : flips.removed) count(mesh.vertices(c), ~std::uint64_t{0});
  for (const auto& v : flips.added) count(v, 1);
  MPI_Alltoall(mine.data(), 2, MPI_UINT64_T, theirs.data(), 2, MPI_UINT64_T, comm);
  return !any_rank(comm, !found || theirs != expected);
}

}  // namespace poreslip
