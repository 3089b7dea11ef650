// fix ID group poreforce PROPERTY
#pragma once

#include <string>

#include "fix.h"

namespace LAMMPS_NS {
class FixPropertyAtom;
}

namespace poreslip {

// Adds the three values of a `fix property/atom ... vector` to the force on each grain: the same as
// `fix addforce` with three atom-style variables, without their cost.
class FixPoreForce : public LAMMPS_NS::Fix {
 public:
  FixPoreForce(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  int setmask() override;
  void init() override;
  void setup(int vflag) override;
  void post_force(int vflag) override;
  double compute_vector(int component) override;

 private:
  std::string property_;  // id of the fix property/atom
  LAMMPS_NS::FixPropertyAtom *forces_ = nullptr;
};

}  // namespace poreslip
