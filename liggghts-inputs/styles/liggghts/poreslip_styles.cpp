#include <mpi.h>

#include "poreslip_styles.h"

#include <algorithm>

#include "contacts.h"
#include "fix_bond_settings.h"
#include "fix_damping_local.h"
#include "fix_poreforce.h"
#include "fix_poreforce_two_way.h"
#include "fix_wall_plane.h"
#include "instance_state.h"
#include "lammps.h"
#include "modify.h"

namespace {

using LAMMPS_NS::Fix;
using LAMMPS_NS::LAMMPS;
using LAMMPS_NS::Modify;

using FixCreator = Fix *(*)(LAMMPS *, int, char **);
using FixMap = std::map<std::string, FixCreator>;

// Modify keeps its table of fix styles private. Naming a private member is allowed in an explicit
// instantiation, which hands the pointer to member out through a friend.
struct FixMapMember {
  friend FixMap *Modify::*fix_map_member(FixMapMember);
};
template <FixMap *Modify::*Member>
struct HandOut {
  friend FixMap *Modify::*fix_map_member(FixMapMember) { return Member; }
};
template struct HandOut<&Modify::fix_map>;

template <class Style>
Fix *create(LAMMPS *lmp, int narg, char **arg)
{
  return new Style(lmp, narg, arg);
}

poreslip::FixWallPlane *find_wall(void *lmp, const char *fix_id)
{
  return dynamic_cast<poreslip::FixWallPlane *>(static_cast<LAMMPS *>(lmp)->modify->find_fix_id(fix_id));
}

}  // namespace

extern "C" {

void poreslip_register_styles(void *handle)
{
  auto *lmp = static_cast<LAMMPS *>(handle);
  FixMap &styles = *(lmp->modify->*fix_map_member(FixMapMember{}));
  if (styles.count("bond/settings")) return;
  poreslip::state_of(lmp) = {};  // the address may have been another instance's
  styles["bond/settings"] = &create<poreslip::FixBondSettings>;
  styles["damping/local"] = &create<poreslip::FixDampingLocal>;
  styles["poreforce"] = &create<poreslip::FixPoreForce>;
  styles["poreforce/two_way"] = &create<poreslip::FixPoreForceTwoWay>;
  styles["wall/plane"] = &create<poreslip::FixWallPlane>;
}

int poreslip_break_count(void *lmp)
{
  return static_cast<int>(poreslip::state_of(static_cast<LAMMPS *>(lmp)).breaks.size());
}

int poreslip_take_breaks(void *lmp, double *out, int capacity)
{
  auto &breaks = poreslip::state_of(static_cast<LAMMPS *>(lmp)).breaks;
  const auto taken = std::min(static_cast<std::ptrdiff_t>(std::max(capacity, 0)), std::ssize(breaks));
  for (std::ptrdiff_t row = 0; row < taken; ++row)
    out = std::copy(breaks[row].begin(), breaks[row].end(), out);
  breaks.erase(breaks.begin(), breaks.begin() + taken);
  return static_cast<int>(taken);
}

void poreslip_clear_breaks(void *lmp) { poreslip::state_of(static_cast<LAMMPS *>(lmp)).breaks.clear(); }

long poreslip_count_bonds(void *lmp) { return poreslip::count_intact_bonds(static_cast<LAMMPS *>(lmp)); }

int poreslip_contacts(void *lmp, double *out, int capacity)
{
  static std::vector<poreslip::ContactRow> rows;
  if (!poreslip::contacts_are_linear(static_cast<LAMMPS *>(lmp))) return -2;
  if (!poreslip::collect_contacts(static_cast<LAMMPS *>(lmp), rows)) return -1;
  const auto written = std::min(static_cast<std::ptrdiff_t>(std::max(capacity, 0)), std::ssize(rows));
  for (std::ptrdiff_t row = 0; row < written; ++row) out = std::copy(rows[row].begin(), rows[row].end(), out);
  return static_cast<int>(rows.size());
}

int poreslip_wall_set_fluid_force(void *lmp, const char *fix_id, double force)
{
  poreslip::FixWallPlane *wall = find_wall(lmp, fix_id);
  if (wall == nullptr) return -1;
  wall->set_fluid_force(force);
  return 0;
}

int poreslip_wall_state(void *lmp, const char *fix_id, double *out)
{
  poreslip::FixWallPlane *wall = find_wall(lmp, fix_id);
  if (wall == nullptr) return -1;
  std::copy_n(wall->state(), static_cast<int>(poreslip::FixWallPlane::state_columns), out);
  return 0;
}

int poreslip_couple_fluid(void *lmp, const char *fix_id, poreslip_fluid_step step, void *fluid, int groups, int planes,
                          const char *const *plane_id, const int *face, const int *parts)
{
  auto *coupled = dynamic_cast<poreslip::FixPoreForceTwoWay *>(static_cast<LAMMPS *>(lmp)->modify->find_fix_id(fix_id));
  if (coupled == nullptr) return -1;
  std::vector<poreslip::FixPoreForceTwoWay::Plane> found;
  for (int w = 0; w < planes; ++w) {
    found.push_back({find_wall(lmp, plane_id[w]), face[w], parts[w]});
    if (found.back().wall == nullptr) return -2;
  }
  coupled->couple(step, fluid, groups, std::move(found));
  return 0;
}

}  // extern "C"
