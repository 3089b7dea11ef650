#include <mpi.h>

#include "contacts.h"

#include <cmath>
#include <utility>

#include "atom.h"
#include "bond_history.h"
#include "force.h"
#include "global_properties.h"
#include "lammps.h"
#include "neigh_list.h"
#include "pair_gran_proxy.h"
#include "property_registry.h"

namespace poreslip {

namespace {

using LAMMPS_NS::PairGranProxy;

// The pair style, if its lists belong to the grains that are here now.
PairGranProxy *pair_with_list(LAMMPS_NS::LAMMPS *lmp)
{
  auto *pair = dynamic_cast<PairGranProxy *>(lmp->force->pair);
  if (pair == nullptr || pair->list == nullptr || pair->listgranhistory == nullptr) return nullptr;
  if (pair->list->firstneigh == nullptr || pair->list->inum != lmp->atom->nlocal) return nullptr;
  return pair;
}

// Calls visit(i, j, history of the contact) for each pair of the list that is counted on this rank.
template <class Visitor>
void for_each_pair(LAMMPS_NS::LAMMPS *lmp, PairGranProxy *pair, Visitor visit)
{
  const LAMMPS_NS::Atom *atom = lmp->atom;
  const LAMMPS_NS::NeighList *list = pair->list;
  const int stride = pair->dnum();
  const bool on_both_ranks = !lmp->force->newton_pair;
  for (int n = 0; n < list->inum; ++n) {
    const int i = list->ilist[n];
    const int *neighbours = list->firstneigh[i];
    double *histories = pair->listgranhistory->firstdouble[i];
    for (int m = 0; m < list->numneigh[i]; ++m) {
      const int j = neighbours[m] & NEIGHMASK;
      if (on_both_ranks && j >= atom->nlocal && atom->tag[i] > atom->tag[j]) continue;
      visit(i, j, histories + stride * m);
    }
  }
}

}  // namespace

bool contacts_are_linear(LAMMPS_NS::LAMMPS *lmp)
{
  auto *pair = dynamic_cast<PairGranProxy *>(lmp->force->pair);
  return pair != nullptr && pair->contact_match("normal", "hooke/stiffness") &&
         (pair->contact_match("tangential", "history") || pair->contact_match("tangential", "bond"));
}

long count_intact_bonds(LAMMPS_NS::LAMMPS *lmp)
{
  PairGranProxy *pair = pair_with_list(lmp);
  if (pair == nullptr) return -1;
  const int offset = pair->get_history_offset("bond");
  if (offset < 0) return -1;
  long bonds = 0;
  for_each_pair(lmp, pair, [&](int, int, const double *history) { bonds += is_bonded(history + offset); });
  return bonds;
}

bool collect_contacts(LAMMPS_NS::LAMMPS *lmp, std::vector<ContactRow> &rows)
{
  rows.clear();
  PairGranProxy *pair = pair_with_list(lmp);
  if (pair == nullptr) return false;
  const int offset = pair->get_history_offset("bond");
  const bool has_bonds = offset >= 0;
  const int shear_offset = has_bonds ? offset : 0;  // `tangential history` keeps its shear first
  PropertyRegistry &registry = lmp->force->registry;
  registry.registerProperty("k_n", &MODEL_PARAMS::createKn);
  registry.registerProperty("k_t", &MODEL_PARAMS::createKt);
  double **const kn = registry.getMatrixProperty("k_n", "poreslip_contacts")->data;
  double **const kt = registry.getMatrixProperty("k_t", "poreslip_contacts")->data;

  const LAMMPS_NS::Atom *atom = lmp->atom;
  const double *radius = atom->radius;
  for_each_pair(lmp, pair, [&](int i, int j, const double *history) {
    const double *xi = atom->x[i], *xj = atom->x[j];
    const double d[3] = {xi[0] - xj[0], xi[1] - xj[1], xi[2] - xj[2]};
    const double squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    const double sum = radius[i] + radius[j];
    const bool bonded = has_bonds && is_bonded(history + offset);
    if (squared >= sum * sum && !bonded) return;
    const double distance = std::sqrt(squared);
    const double overlap = sum - distance;
    const double gap_offset = bonded ? history[offset + bond_gap_offset] : 0.0;
    const int type_i = atom->type[i], type_j = atom->type[j];
    const laws::Springs springs{kn[type_i][type_j] / lmp->force->nktv2p, kt[type_i][type_j] / lmp->force->nktv2p};
    const bool swap = atom->tag[i] > atom->tag[j];
    const double sign = swap ? 1.0 : -1.0;  // the history is seen from i
    const double *shear = history + shear_offset;
    const double arm = (radius[i] - 0.5 * overlap) / distance;
    ContactRow row;
    row[contact_id_i] = atom->tag[swap ? j : i];
    row[contact_id_j] = atom->tag[swap ? i : j];
    row[contact_type_i] = swap ? type_j : type_i;
    row[contact_type_j] = swap ? type_i : type_j;
    row[contact_bonded] = bonded ? 1.0 : 0.0;
    row[contact_normal_force] = laws::bonded_normal_force(springs, overlap, gap_offset);
    for (int c = 0; c < 3; ++c) {
      row[contact_shear_x + c] = sign * springs.shear * shear[c];
      row[contact_x + c] = xi[c] - arm * d[c];
    }
    row[contact_overlap] = overlap;
    const double sheared = std::sqrt(shear[0] * shear[0] + shear[1] * shear[1] + shear[2] * shear[2]);
    row[contact_energy] = laws::spring_energy(springs, row[contact_normal_force], springs.shear * sheared);
    rows.push_back(row);
  });
  return true;
}

}  // namespace poreslip
