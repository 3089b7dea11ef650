#include "tessellation/hilbert.hpp"

namespace poreslip {

// Skilling, AIP Conf. Proc. 707, 381 (2004): undo the excess rotations level by level, then Gray-code and interleave.
std::uint64_t hilbert_index(std::array<std::uint32_t, 3> point) {
  constexpr int bits = 21;
  for (std::uint32_t q = 1u << (bits - 1); q > 1; q >>= 1) {
    const std::uint32_t below = q - 1;
    for (int i = 0; i < 3; ++i) {
      if (point[i] & q) {
        point[0] ^= below;
      } else {
        const std::uint32_t swap = (point[0] ^ point[i]) & below;
        point[0] ^= swap;
        point[i] ^= swap;
      }
    }
  }
  point[1] ^= point[0];
  point[2] ^= point[1];
  std::uint32_t mask = 0;
  for (std::uint32_t q = 1u << (bits - 1); q > 1; q >>= 1)
    if (point[2] & q) mask ^= q - 1;
  for (auto& p : point) p ^= mask;
  std::uint64_t index = 0;
  for (int bit = bits - 1; bit >= 0; --bit)
    for (int i = 0; i < 3; ++i) index = (index << 1) | ((point[i] >> bit) & 1u);
  return index;
}

}  // namespace poreslip
