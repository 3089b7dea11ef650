// Order of points along a Hilbert curve, so that neighbours in space are neighbours in memory.
#pragma once

#include <array>
#include <cstdint>

namespace poreslip {

// Position along the curve (63 bits) of a point given by three coordinates of 21 bits each.
std::uint64_t hilbert_index(std::array<std::uint32_t, 3> point);

}  // namespace poreslip
