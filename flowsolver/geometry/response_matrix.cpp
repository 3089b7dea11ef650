#include "geometry/response_matrix.hpp"

#include <algorithm>
#include <cstring>

namespace poreslip::geometry {
namespace {

struct Member {
  std::int32_t body;
  Four gradient;
};

// Calls visit(cell, members) for all cells that count: the bodies that its volume depends on, and dV/dx.
template <class Visit>
void for_each_cell(const CellGradients& cells, const bool* counted, const std::vector<Roof>& roofs, std::int32_t wall, Visit visit) {
  std::vector<Member> members;
  auto roof = roofs.begin();
  for (std::size_t c = 0; c < cells.grain.size(); ++c) {
    if (!counted[c]) continue;
    std::array<Four, 4> gradient;
    for (int k = 0; k < 3; ++k) gradient[k] = load(&cells.gradient[9 * c + 3 * k]);
    gradient[3] = -(gradient[0] + gradient[1] + gradient[2]);
    members.clear();
    for (int k = 0; k < 4; ++k)
      if (cells.grain[c][k] != wall) members.push_back({cells.grain[c][k], gradient[k]});
    while (roof != roofs.end() && roof->cell < c) ++roof;
    for (; roof != roofs.end() && roof->cell == c; ++roof) {
      const Four area{roof->area, 0.0, 0.0, 0.0};
      const auto same = std::find_if(members.begin(), members.end(), [&](const Member& m) { return m.body == roof->body; });
      if (same == members.end()) members.push_back({roof->body, area});
      else same->gradient += area;
    }
    visit(c, members);
  }
}

// Adds by[r] * to[q] as element q of column r of a block. In parts that are always the same: what was stored just before is then at hand.
inline void add_columns(double* block, const Four& by, const Four& to) {
  const Four first = load(block) + __builtin_shufflevector(by, by, 0, 0, 0, 1) * __builtin_shufflevector(to, to, 0, 1, 2, 0);
  const Four second = load(block + 4) + __builtin_shufflevector(by, by, 1, 1, 2, 2) * __builtin_shufflevector(to, to, 1, 2, 0, 1);
  std::memcpy(block, &first, sizeof first);
  std::memcpy(block + 4, &second, sizeof second);
  block[8] += by[2] * to[2];
}

}  // namespace

void ResponseMatrix::connect(const CellGradients& cells, const bool* counted, const std::vector<Roof>& roofs, std::size_t bodies, std::int32_t wall) {
  wall_ = wall;
  struct Pair {
    std::int32_t first, second;
  };
  std::vector<Pair> pairs;
  pairs.reserve(6 * cells.grain.size());
  for_each_cell(cells, counted, roofs, wall, [&](std::size_t, const std::vector<Member>& members) {
    for (std::size_t k = 0; k < members.size(); ++k)
      for (std::size_t l = k + 1; l < members.size(); ++l) pairs.push_back({members[k].body, members[l].body});
  });
  // Edges, by the lower of their bodies: pairs of the same two are one.
  std::vector<std::int32_t> end(bodies + 1, 0), by_low(pairs.size());
  for (const Pair& p : pairs) ++end[std::min(p.first, p.second) + 1];
  for (std::size_t i = 0; i < bodies; ++i) end[i + 1] += end[i];
  for (std::size_t p = 0; p < pairs.size(); ++p) by_low[end[std::min(pairs[p].first, pairs[p].second)]++] = static_cast<std::int32_t>(p);
  std::vector<std::int32_t> edge_of_pair(pairs.size()), edge_to(bodies, -1), high, first_edge{0};
  for (std::size_t i = 0, k = 0; i < bodies; ++i) {
    for (; k < static_cast<std::size_t>(end[i]); ++k) {
      const Pair& p = pairs[by_low[k]];
      const std::int32_t other = std::max(p.first, p.second);
      if (edge_to[other] < first_edge[i]) {
        edge_to[other] = static_cast<std::int32_t>(high.size());
        high.push_back(other);
      }
      edge_of_pair[by_low[k]] = edge_to[other];
    }
    first_edge.push_back(static_cast<std::int32_t>(high.size()));
  }
  // A body takes as many of its edges as fill packs, and leaves the others to bodies that come later.
  pack_.clear();
  pack_.reserve((high.size() + bodies) / edges);
  std::vector<std::int32_t> place(high.size()), left_to(bodies, -1), next_left(high.size()), taken;
  for (std::size_t i = 0; i < bodies; ++i) {
    taken.clear();
    for (std::int32_t e = left_to[i]; e >= 0; e = next_left[e]) taken.push_back(~e);
    const std::int32_t own = first_edge[i + 1] - first_edge[i];
    const std::int32_t spare = std::min(own, static_cast<std::int32_t>((taken.size() + own) % edges));
    for (std::int32_t e = first_edge[i]; e < first_edge[i] + spare; ++e) {
      next_left[e] = left_to[high[e]];
      left_to[high[e]] = e;
    }
    for (std::int32_t e = first_edge[i] + spare; e < first_edge[i + 1]; ++e) taken.push_back(e);
    for (std::size_t t = 0; t < taken.size(); ++t) {
      if (t % edges == 0) pack_.push_back({.other = {wall, wall, wall, wall}, .body = static_cast<std::int32_t>(i)});
      const std::int32_t at = static_cast<std::int32_t>(edges * (pack_.size() - 1) + t % edges);
      const bool is_high = taken[t] < 0;
      place[is_high ? ~taken[t] : taken[t]] = is_high ? ~at : at;
    }
  }
  place_.resize(pairs.size());
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    const std::int32_t at = place[edge_of_pair[p]];
    const std::int32_t number = at < 0 ? ~at : at;
    Pack& pack = pack_[number / edges];
    const bool first_is_body = pairs[p].first == pack.body;
    pack.other[number % edges] = first_is_body ? pairs[p].second : pairs[p].first;
    place_[p] = first_is_body ? number : ~number;
  }
  own_.resize(9 * bodies + 1);
}

void ResponseMatrix::assemble(const CellGradients& cells, const bool* counted, const std::vector<Roof>& roofs, const double* stiffness) {
  for (Pack& pack : pack_) pack.block = {};
  std::fill(own_.begin(), own_.end(), 0.0);
  auto place = place_.begin();
  for_each_cell(cells, counted, roofs, wall_, [&](std::size_t c, const std::vector<Member>& members) {
    for (std::size_t k = 0; k < members.size(); ++k) {
      const Four pushed = -stiffness[c] * members[k].gradient;
      add_columns(&own_[9 * static_cast<std::size_t>(members[k].body)], pushed, members[k].gradient);
      for (std::size_t l = k + 1; l < members.size(); ++l) {
        const std::int32_t at = *place++;
        const int number = at < 0 ? ~at : at;
        const Four &of_body = at < 0 ? members[l].gradient : pushed, &of_other = at < 0 ? pushed : members[l].gradient;
        add_columns(pack_[number / edges].block[number % edges].data(), of_body, of_other);
      }
    }
  });
}

void ResponseMatrix::add_mutual(const Four* displacement, Four* force) const {
  constexpr std::size_t ahead = 64;  // packs: the engine has thrown them out of the near caches. A prefetch past the end does nothing.
  constexpr Four zero{};
  for (const Pack& pack : pack_) {
    const char* const next = reinterpret_cast<const char*>(&pack + ahead);
    for (std::size_t line = 0; line < sizeof pack; line += 64) __builtin_prefetch(next + line, 0, 2);
    const auto* const own = reinterpret_cast<const double*>(displacement + pack.body);
    const double x = own[0], y = own[1], z = own[2];
    Four by_x{}, by_y{}, by_z{};  // their components' sums are what the others push the body by
#pragma GCC unroll 4
    for (int edge = 0; edge < edges; ++edge) {
      const std::int32_t other = pack.other[edge];
      const double* const block = pack.block[edge].data();
      const Four column_x = load(block), column_y = load(block + 3), column_z = load(block + 6), way = displacement[other];
      force[other] += column_x * x + column_y * y + column_z * z;
      by_x += column_x * way;
      by_y += column_y * way;
      by_z += column_z * way;
    }
    const Four sums = __builtin_shufflevector(by_x, by_y, 0, 4, 2, 6) + __builtin_shufflevector(by_x, by_y, 1, 5, 3, 7);
    const Four sum_z = __builtin_shufflevector(by_z, zero, 0, 4, 2, 6) + __builtin_shufflevector(by_z, zero, 1, 5, 3, 7);
    force[pack.body] += __builtin_shufflevector(sums, sum_z, 0, 1, 4, 5) + __builtin_shufflevector(sums, sum_z, 2, 3, 6, 7);
  }
}

}  // namespace poreslip::geometry
