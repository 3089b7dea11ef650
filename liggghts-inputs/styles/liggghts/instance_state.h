// What the styles of one LIGGGHTS instance share: how bonding is armed, and the log of broken bonds.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_set>
#include <vector>

#include "../laws/bond_strength.h"

namespace LAMMPS_NS {
class LAMMPS;
}

namespace poreslip {

// One row of the break log, in the order in which it is handed out.
enum BreakColumn { break_step, break_id_i, break_id_j, break_mode, break_x, break_y, break_z,
                   break_normal_force, break_shear_force, break_energy, break_columns };
using BreakRow = std::array<double, break_columns>;

struct Arming {
  bool armed = false;
  laws::StrengthDistribution strength;
  double shear_ratio = 1.0;
  double gap = 0.0;   // m
  int group_bit = 1;  // both grains of a bond are in this group
  int types = 0;      // size of the square table below, atom types start at 1
  std::vector<char> bondable;

  bool allows(int type_i, int type_j) const { return bondable[type_i * (types + 1) + type_j] != 0; }
};

// Counted on the rank that owns the grain of lower id.
struct BondCounts {
  double formed = 0.0;
  double at_floor = 0.0;
  double broken_in_tension = 0.0;
  double broken_in_shear = 0.0;
};

struct BrokenPair {
  std::uint64_t key;
  std::uint64_t state;  // laws::BondState
  BreakRow row;
};

struct InstanceState {
  Arming arming;
  double stretch_max = 0.0;  // of the pair style
  BondCounts counts;
  std::vector<BreakRow> breaks;
  std::unordered_set<std::uint64_t> broken_pairs;  // never bonded again; known to all ranks
  std::vector<BrokenPair> newly_broken;            // seen on this rank, not yet told to the others

  // For the copy of the contact that is counted.
  void record_break(const BreakRow &row)
  {
    breaks.push_back(row);
    (row[break_mode] == 1.0 ? counts.broken_in_tension : counts.broken_in_shear) += 1.0;
  }
};

// Pair of ids in one word, lower id in the upper half.
std::uint64_t pair_key(int id_i, int id_j);

// The state of this instance, made on first use. The reference stays good for the process.
InstanceState &state_of(LAMMPS_NS::LAMMPS *lmp);

}  // namespace poreslip
