// fix ID group damping/local alpha
#pragma once

#include "fix.h"

namespace poreslip {

// Local damping of forces and moments; acts on what the fixes defined before it have summed up.
class FixDampingLocal : public LAMMPS_NS::Fix {
 public:
  FixDampingLocal(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  int setmask() override;
  void setup(int vflag) override;
  void post_force(int vflag) override;

 private:
  double alpha_ = 0.0;
};

}  // namespace poreslip
