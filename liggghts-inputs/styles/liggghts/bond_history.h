// The history values of one contact of `tangential bond`, as LIGGGHTS stores them.
#pragma once

#include "../laws/contact_bond.h"

namespace poreslip {

enum BondHistory { bond_shear_x, bond_shear_y, bond_shear_z,  // shear displacement, m
                   bond_state_value,                          // laws::BondState
                   bond_gap_offset,                           // m
                   bond_tension_limit, bond_shear_limit,      // N
                   bond_history_size };

inline laws::BondState bond_state(const double *history)
{
  return static_cast<laws::BondState>(static_cast<int>(history[bond_state_value]));
}

inline void set_bond_state(double *history, laws::BondState state)
{
  history[bond_state_value] = static_cast<double>(static_cast<int>(state));
}

inline bool is_bonded(const double *history) { return bond_state(history) == laws::BondState::bonded; }

}  // namespace poreslip
