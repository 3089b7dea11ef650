// fix ID group bond/settings strength_mean M strength_sd D [strength_floor F] [shear_ratio R] seed N
//   [gap G] types I J [K L ...] armed yes|no
#pragma once

#include <vector>

#include "fix.h"
#include "instance_state.h"

namespace poreslip {

// Arms the contact bond of `pair_style gran ... tangential bond`: while armed, contacts of the listed
// pairs of types are bonded, each with its own strength.
class FixBondSettings : public LAMMPS_NS::Fix {
 public:
  FixBondSettings(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  ~FixBondSettings() override;
  int setmask() override;
  void init() override;
  void setup_pre_neighbor() override { pre_neighbor(); }
  void pre_neighbor() override;
  int modify_param(int narg, char **arg) override;
  double compute_scalar() override;
  double compute_vector(int column) override;
  void write_restart(FILE *file) override;
  void restart(char *data) override;

 private:
  void read_types(class Arguments &arguments);
  std::vector<BrokenPair> gather_newly_broken() const;
  void align_copies(const std::vector<BrokenPair> &broken);
  void check_gap() const;

  InstanceState &state_;
  Arming settings_;
};

}  // namespace poreslip
