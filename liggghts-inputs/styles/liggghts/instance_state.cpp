#include "instance_state.h"

#include <algorithm>
#include <unordered_map>

namespace poreslip {

std::uint64_t pair_key(int id_i, int id_j)
{
  const auto [low, high] = std::minmax(id_i, id_j);
  return static_cast<std::uint64_t>(low) << 32 | static_cast<std::uint32_t>(high);
}

InstanceState &state_of(LAMMPS_NS::LAMMPS *lmp)
{
  static std::unordered_map<LAMMPS_NS::LAMMPS *, InstanceState> states;
  return states[lmp];
}

}  // namespace poreslip
