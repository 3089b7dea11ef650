#include <mpi.h>

#include "fix_poreforce.h"

#include "arguments.h"
#include "atom.h"
#include "fix_property_atom.h"
#include "modify.h"

namespace poreslip {

FixPoreForce::FixPoreForce(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  Arguments arguments(lmp, std::string("fix ") + id + " poreforce", narg, arg, 3);
  property_ = arguments.word("property", "the id of a fix property/atom with three values");
  if (!arguments.done()) arguments.refuse("an argument after property", arg[4], "none");
  vector_flag = 1;
  size_vector = 3;
  global_freq = 1;
  extvector = 1;
}

int FixPoreForce::setmask() { return LAMMPS_NS::FixConst::POST_FORCE; }

void FixPoreForce::init()
{
  forces_ = dynamic_cast<LAMMPS_NS::FixPropertyAtom *>(modify->find_fix_id(property_.c_str()));
  if (forces_ == nullptr || forces_->array_atom == nullptr || forces_->get_nvalues() != 3)
    error->all(FLERR, (std::string("fix ") + id + " poreforce: property is " + property_ +
                       ", allowed: the id of a fix property/atom with three values, such as 'fix " + property_ +
                       " all property/atom f_pf vector yes no no 0. 0. 0.'").c_str());
}

void FixPoreForce::setup(int vflag) { post_force(vflag); }

void FixPoreForce::post_force(int)
{
  const int n = atom->nlocal;
  if (n == 0) return;
  // Arrays of atoms are contiguous.
  const double *const added = forces_->array_atom[0];
  double *const f = atom->f[0];
  if (igroup == 0) {
    for (int k = 0; k < 3 * n; ++k) f[k] += added[k];
    return;
  }
  for (int i = 0; i < n; ++i) {
    if (!(atom->mask[i] & groupbit)) continue;
    for (int c = 0; c < 3; ++c) f[3 * i + c] += added[3 * i + c];
  }
}

double FixPoreForce::compute_vector(int component)
{
  double here = 0.0;
  if (forces_ != nullptr)
    for (int i = 0; i < atom->nlocal; ++i)
      if (atom->mask[i] & groupbit) here += forces_->array_atom[i][component];
  double total = 0.0;
  MPI_Allreduce(&here, &total, 1, MPI_DOUBLE, MPI_SUM, world);
  return total;
}

}  // namespace poreslip
