// A cell's name, the same on every rank and for every periodic copy.
#pragma once

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>

#include "tessellation/domain.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

// Vertices by id and by shift relative to the leading vertex, sorted.
struct CellKey {
  struct Item {
    std::int64_t id;
    std::array<std::int8_t, 8> shift;
    auto operator<=>(const Item&) const = default;
  };
  std::array<Item, 4> item;
  bool operator==(const CellKey&) const = default;
};

inline CellKey cell_key(const std::array<Vertex, 4>& v, const LocalGrains& grains) {
  const auto& origin = grains.shift[leading_vertex(v.data(), 4, grains)];
  CellKey key{};
  for (int k = 0; k < 4; ++k) {
    key.item[k].id = is_wall(v[k]) ? v[k] : grains.id[v[k]];
    if (is_wall(v[k])) continue;
    for (int d = 0; d < 3; ++d) key.item[k].shift[d] = static_cast<std::int8_t>(grains.shift[v[k]][d] - origin[d]);
  }
  std::sort(key.item.begin(), key.item.end());
  return key;
}

inline std::uint64_t mixed(std::uint64_t hash, std::uint64_t value) {
  hash = (hash ^ value) * 0x9e3779b97f4a7c15ull;
  return hash ^ (hash >> 29);
}

struct CellKeyHash {
  std::size_t operator()(const CellKey& key) const {
    std::uint64_t h = 0;
    for (const auto& i : key.item) h = mixed(h, static_cast<std::uint64_t>(i.id));
    return h;
  }
};

}  // namespace poreslip
