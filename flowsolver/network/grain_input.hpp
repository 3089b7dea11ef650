// What a caller hands over at each update: its rank's own grains and the planes of the walls.
#pragma once

#include <cstddef>
#include <cstdint>

namespace poreslip {

struct GrainInput {
  std::size_t count;
  const std::int64_t* id;        // (n,)
  const double* position;        // (n, 3), m
  const double* radius;          // (n,), m
  const std::int32_t* group;     // (n,), row of wall_position; null: all zero
  std::size_t groups;            // rows of wall_position, at least one
  const double* wall_position;   // (groups, 6), m
};

}  // namespace poreslip
