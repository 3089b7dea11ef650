#include <mpi.h>

#include "fix_damping_local.h"

#include "arguments.h"
#include "atom.h"

#include "../laws/local_damping.h"

namespace poreslip {

FixDampingLocal::FixDampingLocal(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  Arguments arguments(lmp, std::string("fix ") + id + " damping/local", narg, arg, 3);
  alpha_ = arguments.number("alpha", [](double a) { return a >= 0.0 && a < 1.0; }, "0 to below 1");
  if (!arguments.done()) arguments.refuse("an argument after alpha", arg[4], "none");
}

int FixDampingLocal::setmask() { return LAMMPS_NS::FixConst::POST_FORCE; }

void FixDampingLocal::setup(int vflag) { post_force(vflag); }

void FixDampingLocal::post_force(int)
{
  for (int i = 0; i < atom->nlocal; ++i) {
    if (!(atom->mask[i] & groupbit)) continue;
    laws::damp_locally(alpha_, atom->v[i], atom->f[i]);
    laws::damp_locally(alpha_, atom->omega[i], atom->torque[i]);
  }
}

}  // namespace poreslip
