#include "tessellation/hilbert.hpp"

namespace poreslip {

namespace {

constexpr int bits = 21;

// Two zeros between each bit and the next.
std::uint64_t spread(std::uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffff;
  x = (x | x << 16) & 0x001f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

}  // namespace

// Skilling, AIP Conf. Proc. 707, 381 (2004): undo the excess rotations level by level, then Gray-code and interleave. Without branches: no
// processor would foresee them.
std::uint64_t hilbert_index(std::array<std::uint32_t, 3> point) {
  for (int level = bits - 1; level > 0; --level) {
    const std::uint32_t below = (1u << level) - 1;
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t set = -((point[i] >> level) & 1u);
      const std::uint32_t swap = (point[0] ^ point[i]) & below & ~set;
      point[0] ^= (below & set) | swap;
      point[i] ^= swap;
    }
  }
  point[1] ^= point[0];
  point[2] ^= point[1];
  std::uint32_t mask = 0;
  for (int level = bits - 1; level > 0; --level) mask ^= -((point[2] >> level) & 1u) & ((1u << level) - 1);
  return spread(point[0] ^ mask) << 2 | spread(point[1] ^ mask) << 1 | spread(point[2] ^ mask);
}

}  // namespace poreslip
