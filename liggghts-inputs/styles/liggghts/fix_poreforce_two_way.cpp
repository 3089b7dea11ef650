#include <mpi.h>

#include "fix_poreforce_two_way.h"

#include <algorithm>

#include "arguments.h"
#include "atom.h"
#include "fix_property_atom.h"
#include "fix_wall_plane.h"
#include "modify.h"
#include "update.h"

namespace poreslip {

FixPoreForceTwoWay::FixPoreForceTwoWay(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  Arguments arguments(lmp, std::string("fix ") + id + " poreforce/two_way", narg, arg, 3);
  property_ = arguments.word("property", "the id of a fix property/atom with three values");
  if (!arguments.done()) arguments.refuse("an argument after property", arg[4], "none");
  if (igroup != 0) arguments.refuse("group", arg[1], "all: the fluid is between all grains");
}

// Once the grains and planes are where the step takes them, and before grains change their rank.
int FixPoreForceTwoWay::setmask() { return LAMMPS_NS::FixConst::POST_INTEGRATE; }

void FixPoreForceTwoWay::init()
{
  forces_ = dynamic_cast<LAMMPS_NS::FixPropertyAtom *>(modify->find_fix_id(property_.c_str()));
  if (forces_ == nullptr || forces_->array_atom == nullptr || forces_->get_nvalues() != 3)
    error->all(FLERR, (std::string("fix ") + id + " poreforce/two_way: property is " + property_ +
                       ", allowed: the id of a fix property/atom with three values, such as 'fix " + property_ +
                       " all property/atom f_pf vector yes no no 0. 0. 0.'").c_str());
}

void FixPoreForceTwoWay::couple(poreslip_fluid_step step, void *fluid, int groups, std::vector<Plane> planes)
{
  step_ = step;
  fluid_ = fluid;
  planes_ = std::move(planes);
  plane_velocity_.assign(6 * groups, 0.0);
  plane_force_.assign(6 * groups, 0.0);
}

void FixPoreForceTwoWay::post_integrate()
{
  if (step_ == nullptr)
    error->all(FLERR, (std::string("fix ") + id + " poreforce/two_way: no fluid is coupled with it").c_str());
  const int groups = static_cast<int>(plane_velocity_.size()) / 6;
  const auto for_each_part = [groups](const Plane &plane, auto visit) {
    for (int g = 0; g < groups; ++g)
      if (plane.parts >> g & 1) visit(6 * g + plane.face);
  };
  for (const Plane &plane : planes_) {
    const double outward = (plane.face % 2 == 0 ? -1.0 : 1.0) * plane.wall->state()[FixWallPlane::velocity];
    for_each_part(plane, [&](int entry) { plane_velocity_[entry] = outward; });
  }
  const int n = atom->nlocal;
  // The velocities of the half step: times dt, the grains' displacements to the last bit but one.
  const char *fault = step_(fluid_, update->dt, n, atom->tag, n > 0 ? atom->v[0] : nullptr, plane_velocity_.data(),
                            n > 0 ? forces_->array_atom[0] : nullptr, plane_force_.data());
  if (fault != nullptr) error->all(FLERR, (std::string("fix ") + id + " poreforce/two_way: " + fault).c_str());
  for (const Plane &plane : planes_) {
    double force = 0.0;
    for_each_part(plane, [&](int entry) { force += plane_force_[entry]; });
    plane.wall->set_fluid_force(force);
  }
}

}  // namespace poreslip
