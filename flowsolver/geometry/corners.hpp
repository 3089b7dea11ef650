// The corners of a block of cells or facets, side by side, for the vectorised kernels.
#pragma once

#include <algorithm>
#include <cstddef>

#include "geometry/view.hpp"

namespace poreslip::geometry {

// Elements that a kernel treats at a time: their corners stay in the first-level cache.
constexpr std::size_t block_size = 128;

// Asks memory for a block's part of an array, eight blocks ahead: a page further on, where processors do not look by themselves. The array
// may end before.
template <class T>
void ask_ahead(const T* array, std::size_t first) {
  constexpr std::size_t line = 64 / sizeof(T), ahead = 8 * block_size;
  for (std::size_t e = 0; e < block_size; e += line) __builtin_prefetch(array + first + ahead + e);
}

// Coordinates and radii of K corners of each element of a block. A grain is fetched whole and four grains are turned into four
// columns in registers: gathering each coordinate by itself takes several times as long.
template <int K>
struct Corners {
  alignas(64) double x[K][block_size], y[K][block_size], z[K][block_size], r[K][block_size];

  // The corners of elements [first, first + count); up to three more are filled with the last one's.
  void fetch(const std::array<const Vertex*, K>& vertex, const PackedGrain* grains, std::size_t first, std::size_t count) {
    for (int k = 0; k < K; ++k) {
      const Vertex* v = vertex[k] + first;
      std::size_t e = 0;
      for (; e + 4 <= count; e += 4) turn(k, e, grains[v[e]], grains[v[e + 1]], grains[v[e + 2]], grains[v[e + 3]]);
      if (e == count) continue;
      const auto at = [&](std::size_t i) -> const PackedGrain& { return grains[v[std::min(i, count - 1)]]; };
      turn(k, e, at(e), at(e + 1), at(e + 2), at(e + 3));
    }
  }

  // Asks memory for the grains of elements [first, last), which are fetched next.
  static void ask(const std::array<const Vertex*, K>& vertex, const PackedGrain* grains, std::size_t first, std::size_t last) {
    for (int k = 0; k < K; ++k)
      for (std::size_t e = first; e < last; ++e) __builtin_prefetch(grains + vertex[k][e]);
  }

 private:
  using Quad [[gnu::vector_size(32)]] = double;

  void turn(int k, std::size_t e, const PackedGrain& g0, const PackedGrain& g1, const PackedGrain& g2, const PackedGrain& g3) {
    const auto quad = [](const PackedGrain& g) { return reinterpret_cast<const Quad&>(g); };
    const Quad a = quad(g0), b = quad(g1), c = quad(g2), d = quad(g3);
    const Quad ab_xz = __builtin_shufflevector(a, b, 0, 4, 2, 6), ab_yr = __builtin_shufflevector(a, b, 1, 5, 3, 7);
    const Quad cd_xz = __builtin_shufflevector(c, d, 0, 4, 2, 6), cd_yr = __builtin_shufflevector(c, d, 1, 5, 3, 7);
    reinterpret_cast<Quad&>(x[k][e]) = __builtin_shufflevector(ab_xz, cd_xz, 0, 1, 4, 5);
    reinterpret_cast<Quad&>(y[k][e]) = __builtin_shufflevector(ab_yr, cd_yr, 0, 1, 4, 5);
    reinterpret_cast<Quad&>(z[k][e]) = __builtin_shufflevector(ab_xz, cd_xz, 2, 3, 6, 7);
    reinterpret_cast<Quad&>(r[k][e]) = __builtin_shufflevector(ab_yr, cd_yr, 2, 3, 6, 7);
  }
};

}  // namespace poreslip::geometry
