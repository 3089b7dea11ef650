// The contact bond as a tangential model of LIGGGHTS:
//   pair_style gran model hooke/stiffness tangential bond [stretch_max 0.05]
// It is a tangential model because that one runs last on the shear history; it adds the tension too.
// The first lines are the form in which LIGGGHTS collects models: name in the deck, free id.
#ifdef TANGENTIAL_MODEL
TANGENTIAL_MODEL(TANGENTIAL_BOND, bond, 20)
#else
#ifndef PORESLIP_TANGENTIAL_MODEL_BOND_H
#define PORESLIP_TANGENTIAL_MODEL_BOND_H

#include <cstdio>

#include "contact_models.h"
#include "tangential_model_base.h"
#include "atom.h"
#include "error.h"
#include "force.h"
#include "global_properties.h"
#include "neighbor.h"
#include "pair_gran.h"
#include "update.h"

#include "../laws/bond_strength.h"
#include "../laws/contact_bond.h"
#include "bond_history.h"
#include "instance_state.h"

namespace LIGGGHTS {
namespace ContactModels {

template <>
class TangentialModel<TANGENTIAL_BOND> : public TangentialModelBase {
 public:
  TangentialModel(LAMMPS *lmp, IContactHistorySetup *history, ContactModelBase *model) :
      TangentialModelBase(lmp, history, nullptr), pair_(dynamic_cast<PairGran *>(history)),
      state_(poreslip::state_of(lmp))
  {
    if (pair_ == nullptr) error->all(FLERR, "tangential bond: made for pair_style gran, not for walls");
    offset_ = history->add_history_value("shear_x", "1");  // "1": changes sign with the pair's order
    for (const char *name : {"shear_y", "shear_z"}) history->add_history_value(name, "1");
    for (const char *name : {"bond_state", "bond_offset", "bond_tension", "bond_shear"})
      history->add_history_value(name, "0");
    model->add_history_offset("bond", offset_);
  }

  void registerSettings(Settings &settings)
  {
    settings.registerDoubleSetting("stretch_max", stretch_max_, 0.05);
    settings.registerOnOff("absolute_damping", absolute_damping_);
    settings.registerOnOff("tangential_damping", tangential_damping_, true);
  }

  void postSettings(IContactHistorySetup *, ContactModelBase *)
  {
    if (!(stretch_max_ > 0.0 && stretch_max_ <= 1.0)) {
      char text[200];
      snprintf(text, sizeof text, "pair_style gran ... tangential bond: stretch_max is %g, allowed: above 0 to 1 "
               "(longest bond as an excess over the radii's sum)", stretch_max_);
      error->all(FLERR, text);
    }
  }

  void connectToProperties(PropertyRegistry &registry)
  {
    const char *caller = "tangential_model bond";
    registry.registerProperty("coeffFrict", &MODEL_PARAMS::createCoeffFrict);
    registry.registerProperty("k_n", &MODEL_PARAMS::createKn);
    registry.registerProperty("k_t", &MODEL_PARAMS::createKt);
    registry.connect("coeffFrict", friction_, caller);
    registry.connect("k_n", normal_stiffness_, caller);
    registry.connect("k_t", shear_stiffness_, caller);
    if (absolute_damping_) {
      registry.registerProperty("gamman_abs", &MODEL_PARAMS::createGammanAbs);
      registry.registerProperty("gammat_abs", &MODEL_PARAMS::createGammatAbs);
      registry.connect("gamman_abs", normal_damping_, caller);
      registry.connect("gammat_abs", shear_damping_, caller);
    } else {
      registry.registerProperty("gamman", &MODEL_PARAMS::createGamman);
      registry.registerProperty("gammat", &MODEL_PARAMS::createGammat);
      registry.connect("gamman", normal_damping_, caller);
      registry.connect("gammat", shear_damping_, caller);
    }
    if (force->newton_pair) error->all(FLERR, "tangential bond needs 'newton off' in the deck");
    state_.stretch_max = stretch_max_;
    // Keeps bonded pairs in the neighbour list, with a margin beyond the stretch that is refused.
    neighbor->register_contact_dist_factor(1.0 + 1.05 * stretch_max_);
  }

  void surfacesIntersect(const SurfacesIntersectData &data, ForceData &on_i, ForceData &on_j)
  {
    if (data.contact_flags) *data.contact_flags |= CONTACT_TANGENTIAL_MODEL;
    double *const history = &data.contact_history[offset_];
    double *const shear = &history[poreslip::bond_shear_x];
    const bool update_history = data.computeflag && data.shearupdate;
    const double tangent_velocity[3] = {data.vtr1, data.vtr2, data.vtr3};
    if (update_history) {
      poreslip::laws::advance_shear(shear, tangent_velocity, data.en, update->dt);
      bond_if_armed(data, data.deltan, history);
    }

    Vector3 shear_force;
    double extra_normal = 0.0;  // the normal model knows nothing of the gap a bond was made across
    bool bonded = poreslip::is_bonded(history);
    if (bonded) {
      const Springs springs{data.kn, data.kt};
      const double normal_force =
          poreslip::laws::bonded_normal_force(springs, data.deltan, history[poreslip::bond_gap_offset]);
      bonded = !update_history || bond_holds(data, data.deltan, springs, normal_force, history);
      extra_normal = normal_force - data.kn * data.deltan;
      shear_force = poreslip::laws::bonded_shear_force(data.kt, data.gammat, shear, tangent_velocity);
    }
    if (!bonded) {
      extra_normal = 0.0;
      const double limit = friction_[data.itype][data.jtype] * std::fabs(data.Fn);
      shear_force = poreslip::laws::frictional_shear_force(data.kt, data.gammat, limit, shear, tangent_velocity,
                                                           update_history).on_i;
    }
    apply(data.en, data.cri, data.crj, extra_normal, shear_force, on_i, on_j);
  }

  void surfacesClose(SurfacesCloseData &close, ForceData &on_i, ForceData &on_j)
  {
    if (close.contact_history == nullptr) return;
    double *const history = &close.contact_history[offset_];
    const bool update_history = close.computeflag && close.shearupdate;
    if (update_history && state_.arming.armed) {
      const double overlap = close.radsum - std::sqrt(close.rsq);
      if (-overlap <= state_.arming.gap) bond_if_armed(close, overlap, history);
    }
    if (!poreslip::is_bonded(history)) {
      if (update_history) forget_shear(close, history);
      return;
    }
    const double distance = std::sqrt(close.rsq);
    const double overlap = close.radsum - distance;
    refuse_overstretched(close, overlap);
    if (close.contact_flags) *close.contact_flags |= CONTACT_TANGENTIAL_MODEL;

    SurfacesIntersectData &data = fill_contact(close, distance);
    double *const shear = &history[poreslip::bond_shear_x];
    const double tangent_velocity[3] = {data.vtr1, data.vtr2, data.vtr3};
    if (update_history) poreslip::laws::advance_shear(shear, tangent_velocity, data.en, update->dt);
    const Springs springs{data.kn, data.kt};
    const double normal_force =
        poreslip::laws::bonded_normal_force(springs, overlap, history[poreslip::bond_gap_offset]);
    if (update_history && !bond_holds(data, overlap, springs, normal_force, history)) {
      forget_shear(close, history);  // no compression, so no friction either
      return;
    }
    data.Fn = normal_force - data.gamman * data.vn;
    const Vector3 shear_force =
        poreslip::laws::bonded_shear_force(data.kt, data.gammat, shear, tangent_velocity);
    apply(data.en, data.cri, data.crj, data.Fn, shear_force, on_i, on_j);
    close.has_force_update = true;
  }

  void beginPass(SurfacesIntersectData &, ForceData &, ForceData &) {}
  void endPass(SurfacesIntersectData &, ForceData &, ForceData &) {}

 private:
  using Springs = poreslip::laws::Springs;
  using Vector3 = poreslip::laws::Vector3;

  void bond_if_armed(const SurfacesCloseData &data, double overlap, double *history)
  {
    using namespace poreslip;
    const Arming &arming = state_.arming;
    if (!arming.armed || bond_state(history) != laws::BondState::never_bonded) return;
    if (!arming.allows(data.itype, data.jtype)) return;
    if (!(atom->mask[data.i] & arming.group_bit) || !(atom->mask[data.j] & arming.group_bit)) return;
    const int id_i = atom->tag[data.i], id_j = atom->tag[data.j];
    if (!state_.broken_pairs.empty() && state_.broken_pairs.count(pair_key(id_i, id_j))) return;
    const laws::BondStrength strength = laws::draw_strength(arming.strength, id_i, id_j);
    const laws::BondLimits limits = laws::bond_limits(strength.stress, arming.shear_ratio, data.radi, data.radj);
    set_bond_state(history, laws::BondState::bonded);
    history[bond_gap_offset] = laws::bond_offset(overlap);
    history[bond_tension_limit] = limits.tension;
    history[bond_shear_limit] = limits.shear;
    if (counted_here(data)) {
      state_.counts.formed += 1.0;
      if (strength.at_floor) state_.counts.at_floor += 1.0;
    }
  }

  // Of the two copies of a contact that spans ranks or a periodic face, the one that is counted.
  bool counted_here(const SurfacesCloseData &data) const
  {
    return data.j < atom->nlocal || atom->tag[data.i] < atom->tag[data.j];
  }

  // Breaks the bond if it is beyond its limits; true if it still holds.
  bool bond_holds(const SurfacesIntersectData &data, double overlap, const Springs &springs, double normal_force,
                  double *history)
  {
    using namespace poreslip;
    const double *const shear = &history[bond_shear_x];
    const double shear_force = springs.shear * std::sqrt(shear[0] * shear[0] + shear[1] * shear[1] + shear[2] * shear[2]);
    const laws::BondLimits limits{history[bond_tension_limit], history[bond_shear_limit]};
    const laws::BondState after = laws::bond_state_under(limits, normal_force, shear_force);
    if (after == laws::BondState::bonded) return true;
    set_bond_state(history, after);
    const BreakRow row = break_row(data, overlap, springs, normal_force, shear_force, after);
    state_.newly_broken.push_back({pair_key(atom->tag[data.i], atom->tag[data.j]), static_cast<std::uint64_t>(after), row});
    if (counted_here(data)) state_.record_break(row);
    return false;
  }

  poreslip::BreakRow break_row(const SurfacesIntersectData &data, double overlap, const Springs &springs,
                               double normal_force, double shear_force, poreslip::laws::BondState after) const
  {
    using namespace poreslip;
    const double friction = friction_[data.itype][data.jtype];
    const double normal_after = laws::frictional_normal_force(springs, overlap);
    const double shear_after = overlap > 0.0 ? std::fmin(shear_force, friction * std::fabs(data.Fn)) : 0.0;
    const double *const x = atom->x[data.i];
    const int id_i = atom->tag[data.i], id_j = atom->tag[data.j];
    return {static_cast<double>(update->ntimestep), static_cast<double>(std::min(id_i, id_j)),
            static_cast<double>(std::max(id_i, id_j)), after == laws::BondState::broken_in_tension ? 1.0 : 2.0,
            x[0] - data.cri * data.en[0], x[1] - data.cri * data.en[1], x[2] - data.cri * data.en[2], normal_force,
            shear_force, laws::spring_energy(springs, normal_force, shear_force) -
                             laws::spring_energy(springs, normal_after, shear_after)};
  }

  // A parted contact has no shear, and need not be kept: broken pairs are known to fix bond/settings.
  void forget_shear(SurfacesCloseData &close, double *history) const
  {
    double *const shear = &history[poreslip::bond_shear_x];
    if (shear[0] != 0.0 || shear[1] != 0.0 || shear[2] != 0.0) shear[0] = shear[1] = shear[2] = 0.0;
    if (close.contact_flags) *close.contact_flags = 0;
  }

  void refuse_overstretched(const SurfacesCloseData &close, double overlap) const
  {
    if (-overlap <= stretch_max_ * close.radsum) return;
    char text[300];
    snprintf(text, sizeof text, "tangential bond: the bond of grains %d and %d is %g of the radii's sum long, more "
             "than stretch_max %g; if the run is unstable, lower loading.time_step_fraction; else give pair_style a larger stretch_max, or bonds "
             "of less strength",
             atom->tag[close.i], atom->tag[close.j], -overlap / close.radsum, stretch_max_);
    error->one(FLERR, text);
  }

  // PairStyles::Granular hands its one SurfacesIntersectData to both callbacks; for a contact without
  // overlap nothing but the close part is set, so the rest is computed here (also for its outputs).
  SurfacesIntersectData &fill_contact(SurfacesCloseData &close, double distance) const
  {
    auto &data = static_cast<SurfacesIntersectData &>(close);
    data.omega_i = atom->omega[close.i];
    data.omega_j = atom->omega[close.j];
    const auto k = poreslip::laws::contact_kinematics({close.delta[0], close.delta[1], close.delta[2]}, distance,
                                                      close.radi, close.radj, close.v_i, close.v_j, data.omega_i,
                                                      data.omega_j);
    data.r = distance;
    data.rinv = 1.0 / distance;
    for (int c = 0; c < 3; ++c) data.en[c] = k.normal[c];
    data.deltan = k.overlap;
    data.cri = k.arm_i;
    data.crj = k.arm_j;
    data.vn = k.normal_velocity;
    data.vtr1 = k.tangent_velocity[0];
    data.vtr2 = k.tangent_velocity[1];
    data.vtr3 = k.tangent_velocity[2];
    data.mi = atom->rmass ? atom->rmass[close.i] : atom->mass[close.itype];
    data.mj = atom->rmass ? atom->rmass[close.j] : atom->mass[close.jtype];
    data.meff = data.mi * data.mj / (data.mi + data.mj);
    const int frozen = pair_->freeze_group_bit();
    if (atom->mask[close.i] & frozen) data.meff = data.mj;
    if (atom->mask[close.j] & frozen) data.meff = data.mi;
    const double mass_factor = absolute_damping_ ? 1.0 : data.meff;
    data.kn = normal_stiffness_[close.itype][close.jtype] / force->nktv2p;
    data.kt = shear_stiffness_[close.itype][close.jtype] / force->nktv2p;
    data.gamman = mass_factor * normal_damping_[close.itype][close.jtype];
    data.gammat = tangential_damping_ ? mass_factor * shear_damping_[close.itype][close.jtype] : 0.0;
    return data;
  }

  static void apply(const double *normal, double arm_i, double arm_j, double normal_force, const Vector3 &shear_force,
                    ForceData &on_i, ForceData &on_j)
  {
    const Vector3 &t = shear_force;
    const double torque[3] = {normal[1] * t[2] - normal[2] * t[1], normal[2] * t[0] - normal[0] * t[2],
                              normal[0] * t[1] - normal[1] * t[0]};
    for (int c = 0; c < 3; ++c) {
      const double total = normal_force * normal[c] + shear_force[c];
      on_i.delta_F[c] += total;
      on_j.delta_F[c] -= total;
      on_i.delta_torque[c] -= arm_i * torque[c];
      on_j.delta_torque[c] -= arm_j * torque[c];
    }
  }

  PairGran *pair_;
  poreslip::InstanceState &state_;
  int offset_ = -1;
  double stretch_max_ = 0.05;
  bool absolute_damping_ = false;
  bool tangential_damping_ = true;
  double **friction_ = nullptr;
  double **normal_stiffness_ = nullptr;
  double **shear_stiffness_ = nullptr;
  double **normal_damping_ = nullptr;
  double **shear_damping_ = nullptr;
};

}  // namespace ContactModels
}  // namespace LIGGGHTS

#endif
#endif
