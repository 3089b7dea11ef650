// fix ID all poreforce/two_way PROPERTY
#pragma once

#include <string>
#include <vector>

#include "fix.h"
#include "poreslip_styles.h"

namespace LAMMPS_NS {
class FixPropertyAtom;
}

namespace poreslip {

class FixWallPlane;

// In each step tells a pore fluid how grains and planes move, and takes the forces that it then has: into a fix property/atom,
// from which fix poreforce adds them, and onto the planes. The fluid is given by poreslip_couple_fluid.
class FixPoreForceTwoWay : public LAMMPS_NS::Fix {
 public:
  // Plane that stands on a face (x low, x high, ... z high) for those groups of grains whose bit is set in `parts`.
  struct Plane {
    FixWallPlane *wall;
    int face, parts;
  };

  FixPoreForceTwoWay(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  int setmask() override;
  void init() override;
  void post_integrate() override;

  void couple(poreslip_fluid_step step, void *fluid, int groups, std::vector<Plane> planes);

 private:
  std::string property_;  // id of the fix property/atom
  LAMMPS_NS::FixPropertyAtom *forces_ = nullptr;
  poreslip_fluid_step step_ = nullptr;
  void *fluid_ = nullptr;
  std::vector<Plane> planes_;
  std::vector<double> plane_velocity_, plane_force_;  // (groups, 6), outward
};

}  // namespace poreslip
