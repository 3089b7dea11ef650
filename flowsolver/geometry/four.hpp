// Vectors in three dimensions as one register each.
#pragma once

#include <cstring>

namespace poreslip::geometry {

// Three components and one that is not used: one vector register.
using Four [[gnu::vector_size(32)]] = double;

// Three values and the one after them, from any address.
inline Four load(const double* from) {
  Four value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

}  // namespace poreslip::geometry
