#include "geometry/response_matrix.hpp"

#include <algorithm>

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

// x, y and z of four bodies.
inline std::array<Four, 3> components(const Four& a, const Four& b, const Four& c, const Four& d) {
  const Four ab = __builtin_shufflevector(a, b, 0, 4, 2, 6), cd = __builtin_shufflevector(c, d, 0, 4, 2, 6);
  const Four ab_y = __builtin_shufflevector(a, b, 1, 5, 3, 7), cd_y = __builtin_shufflevector(c, d, 1, 5, 3, 7);
  return {__builtin_shufflevector(ab, cd, 0, 1, 4, 5), __builtin_shufflevector(ab_y, cd_y, 0, 1, 4, 5), __builtin_shufflevector(ab, cd, 2, 3, 6, 7)};
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
  // A body takes a multiple of four of its edges, so that packs are full, and leaves up to three to bodies that come later.
  pack_.clear();
  pack_.reserve((high.size() + bodies) / 4);
  std::vector<std::int32_t> place(high.size()), left_to(bodies, -1), next_left(high.size()), taken;
  for (std::size_t i = 0; i < bodies; ++i) {
    taken.clear();
    for (std::int32_t e = left_to[i]; e >= 0; e = next_left[e]) taken.push_back(~e);
    const std::int32_t own = first_edge[i + 1] - first_edge[i];
    const std::int32_t spare = std::min(own, static_cast<std::int32_t>((taken.size() + own) % 4));
    for (std::int32_t e = first_edge[i]; e < first_edge[i] + spare; ++e) {
      next_left[e] = left_to[high[e]];
      left_to[high[e]] = e;
    }
    for (std::int32_t e = first_edge[i] + spare; e < first_edge[i + 1]; ++e) taken.push_back(e);
    for (std::size_t t = 0; t < taken.size(); ++t) {
      if (t % 4 == 0) pack_.push_back({{}, {wall, wall, wall, wall}, static_cast<std::int32_t>(i)});
      const std::int32_t at = static_cast<std::int32_t>(4 * (pack_.size() - 1) + t % 4);
      const bool is_high = taken[t] < 0;
      place[is_high ? ~taken[t] : taken[t]] = is_high ? ~at : at;
    }
  }
  place_.resize(pairs.size());
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    const std::int32_t at = place[edge_of_pair[p]];
    const std::int32_t number = at < 0 ? ~at : at;
    Pack& pack = pack_[number / 4];
    const bool first_is_body = pairs[p].first == pack.body;
    pack.other[number % 4] = first_is_body ? pairs[p].second : pairs[p].first;
    place_[p] = first_is_body ? number : ~number;
  }
  own_.resize(9 * bodies + 1);
}

void ResponseMatrix::assemble(const CellGradients& cells, const bool* counted, const std::vector<Roof>& roofs, const double* stiffness) {
  for (Pack& pack : pack_) pack.block.fill(Four{});
  std::fill(own_.begin(), own_.end(), 0.0);
  auto place = place_.begin();
  for_each_cell(cells, counted, roofs, wall_, [&](std::size_t c, const std::vector<Member>& members) {
    for (std::size_t k = 0; k < members.size(); ++k) {
      const Four g = members[k].gradient, pushed = -stiffness[c] * g;
      double* const own = &own_[9 * static_cast<std::size_t>(members[k].body)];
      for (int q = 0; q < 3; ++q)
        for (int r = 0; r < 3; ++r) own[3 * q + r] += pushed[r] * g[q];
      for (std::size_t l = k + 1; l < members.size(); ++l) {
        const std::int32_t at = *place++;
        const Four& other = members[l].gradient;
        const int number = at < 0 ? ~at : at, of_k = at < 0 ? 3 : 1, of_l = at < 0 ? 1 : 3;
        Pack& pack = pack_[number / 4];
        for (int q = 0; q < 3; ++q)
          for (int r = 0; r < 3; ++r) pack.block[of_l * q + of_k * r][number % 4] += pushed[r] * other[q];
      }
    }
  });
}

void ResponseMatrix::add_mutual(const Four* displacement, Four* force) const {
  constexpr std::size_t ahead = 32;  // packs: the engine has thrown them out of the near caches. A prefetch past the end does nothing.
  constexpr Four zero{};
  for (const Pack& pack : pack_) {
    const char* const next = reinterpret_cast<const char*>(&pack + ahead);
    for (std::size_t line = 0; line < sizeof pack; line += 64) __builtin_prefetch(next + line);
    const auto& b = pack.block;
    const auto& other = pack.other;
    const auto [x, y, z] = components(displacement[other[0]], displacement[other[1]], displacement[other[2]], displacement[other[3]]);
    const Four own = displacement[pack.body];
    const double own_x = own[0], own_y = own[1], own_z = own[2];
    // By columns of four others: on each of them, and what all of them push the body by.
    const Four fx = b[0] * own_x + b[1] * own_y + b[2] * own_z, fy = b[3] * own_x + b[4] * own_y + b[5] * own_z, fz = b[6] * own_x + b[7] * own_y + b[8] * own_z;
    const Four by_x = b[0] * x + b[3] * y + b[6] * z, by_y = b[1] * x + b[4] * y + b[7] * z, by_z = b[2] * x + b[5] * y + b[8] * z;
    const Four xy = __builtin_shufflevector(fx, fy, 0, 4, 2, 6), xy_odd = __builtin_shufflevector(fx, fy, 1, 5, 3, 7);
    const Four z_even = __builtin_shufflevector(fz, zero, 0, 4, 2, 6), z_odd = __builtin_shufflevector(fz, zero, 1, 5, 3, 7);
    force[other[0]] += __builtin_shufflevector(xy, z_even, 0, 1, 4, 5);
    force[other[1]] += __builtin_shufflevector(xy_odd, z_odd, 0, 1, 4, 5);
    force[other[2]] += __builtin_shufflevector(xy, z_even, 2, 3, 6, 7);
    force[other[3]] += __builtin_shufflevector(xy_odd, z_odd, 2, 3, 6, 7);
    const Four sums = __builtin_shufflevector(by_x, by_y, 0, 4, 2, 6) + __builtin_shufflevector(by_x, by_y, 1, 5, 3, 7);
    const Four sum_z = __builtin_shufflevector(by_z, zero, 0, 4, 2, 6) + __builtin_shufflevector(by_z, zero, 1, 5, 3, 7);
    force[pack.body] += __builtin_shufflevector(sums, sum_z, 0, 1, 4, 5) + __builtin_shufflevector(sums, sum_z, 2, 3, 6, 7);
  }
}

}  // namespace poreslip::geometry
