#include <mpi.h>

#include "fix_wall_plane.h"

#include <cstring>

#include "arguments.h"
#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "force.h"
#include "input.h"
#include "modify.h"
#include "neighbor.h"
#include "update.h"
#include "variable.h"

#include "../laws/plane_wall.h"

namespace poreslip {

namespace {

bool positive(double value) { return value > 0.0 && std::isfinite(value); }
bool not_negative(double value) { return value >= 0.0 && std::isfinite(value); }
bool finite(double value) { return std::isfinite(value); }

}  // namespace

FixWallPlane::FixWallPlane(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  Arguments arguments(lmp, command(), narg, arg, 3);
  bool has_normal = false, has_position = false, has_stiffness = false, has_motion = false;
  while (!arguments.done()) {
    const std::string keyword = arguments.word("keyword", "");
    if (keyword == "normal") {
      const std::string allowed = "1 0 0, -1 0 0, 0 1 0, 0 -1 0, 0 0 1 or 0 0 -1, pointing into the grains";
      double n[3];
      for (double &component : n) component = arguments.number("normal", finite, allowed);
      int axes = 0;
      for (int c = 0; c < 3; ++c) {
        if (n[c] == 0.0) continue;
        ++axes;
        axis_ = c;
        inward_ = n[c];
      }
      if (axes != 1 || std::fabs(inward_) != 1.0)
        arguments.refuse("normal", text_of(n[0]) + " " + text_of(n[1]) + " " + text_of(n[2]), allowed);
      has_normal = true;
    } else if (keyword == "position") {
      state_[position] = arguments.number(keyword, finite, "a number (m)");
      has_position = true;
    } else if (keyword == "kn") {
      stiffness_ = arguments.number(keyword, positive, "above 0 (N/m)");
      has_stiffness = true;
    } else if (keyword == "gamman") {
      damping_ = arguments.number(keyword, not_negative, "0 or more (1/s)");
    } else if (keyword == "velocity") {
      if (has_motion) arguments.fail("give either velocity or servo, once");
      read_velocity(arguments);
      has_motion = true;
    } else if (keyword == "servo") {
      if (has_motion) arguments.fail("give either velocity or servo, once");
      read_servo(arguments);
      has_motion = true;
    } else if (keyword == "reset") {
      reset_ = arguments.yes_or_no(keyword);
    } else {
      arguments.refuse("keyword", keyword, "normal, position, kn, gamman, velocity, servo, reset");
    }
  }
  if (!has_normal) arguments.refuse("normal", "missing", "a unit vector along an axis");
  if (!has_position) arguments.refuse("position", "missing", "a number (m)");
  if (!has_stiffness) arguments.refuse("kn", "missing", "above 0 (N/m)");
  if (!has_motion) arguments.refuse("velocity or servo", "missing", "velocity V, or servo stress S area A gain C vmax V");

  restart_global = 1;
  vector_flag = 1;
  size_vector = state_columns;
  global_freq = 1;
  extvector = 0;
}

std::string FixWallPlane::command() const { return std::string("fix ") + id + " wall/plane"; }

FixWallPlane::Quantity FixWallPlane::read_quantity(Arguments &arguments, const std::string &keyword)
{
  const std::string allowed = "a number, or v_name of an equal-style variable";
  const std::string text = arguments.word(keyword, allowed);
  if (text.rfind("v_", 0) == 0) return {0.0, text.substr(2)};
  double value = 0.0;
  if (!Arguments::parse(text, value) || !std::isfinite(value)) arguments.refuse(keyword, text, allowed);
  return {value, ""};
}

void FixWallPlane::read_velocity(Arguments &arguments)
{
  state_[velocity] = arguments.number("velocity", finite, "a number (m/s)");
  servo_ = false;
}

void FixWallPlane::read_servo(Arguments &arguments)
{
  bool has_stress = false, has_area = false, has_gain = false, has_limit = false;
  for (int pair = 0; pair < 4; ++pair) {
    const std::string keyword = arguments.word("servo", "stress S area A gain C vmax V");
    if (keyword == "stress") {
      stress_ = read_quantity(arguments, "servo stress");
      has_stress = true;
    } else if (keyword == "area") {
      area_ = read_quantity(arguments, "servo area");
      if (area_.variable.empty() && !positive(area_.number))
        arguments.refuse("servo area", text_of(area_.number), "above 0 (m2)");
      has_area = true;
    } else if (keyword == "gain") {
      gain_ = arguments.number("servo gain", [](double g) { return g > 0.0 && g <= 1.0; }, "above 0 to 1");
      has_gain = true;
    } else if (keyword == "vmax") {
      speed_limit_ = read_quantity(arguments, "servo vmax");
      if (speed_limit_.variable.empty() && !positive(speed_limit_.number))
        arguments.refuse("servo vmax", text_of(speed_limit_.number), "above 0 (m/s)");
      has_limit = true;
    } else {
      arguments.refuse("servo keyword", keyword, "stress, area, gain, vmax");
    }
  }
  if (!(has_stress && has_area && has_gain && has_limit))
    arguments.fail("servo needs each of stress, area, gain, vmax once");
  servo_ = true;
}

int FixWallPlane::modify_param(int narg, char **arg)
{
  Arguments arguments(lmp, "fix_modify " + std::string(id), narg, arg, 0);
  const std::string keyword = arguments.word("keyword", "velocity, servo, position, gamman");
  if (keyword == "velocity") read_velocity(arguments);
  else if (keyword == "servo") read_servo(arguments);
  else if (keyword == "position") state_[position] = arguments.number(keyword, finite, "a number (m)");
  else if (keyword == "gamman") damping_ = arguments.number(keyword, not_negative, "0 or more (1/s)");
  else return 0;
  return arguments.position();
}

int FixWallPlane::setmask() { return LAMMPS_NS::FixConst::INITIAL_INTEGRATE | LAMMPS_NS::FixConst::POST_FORCE; }

void FixWallPlane::init()
{
  const int periodic[3] = {domain->xperiodic, domain->yperiodic, domain->zperiodic};
  if (periodic[axis_])
    error->all(FLERR, (command() + ": the box is periodic across this plane; use boundary f or m there, or no plane").c_str());
  if (servo_) {
    find_variable(stress_, "stress");
    find_variable(area_, "area");
    find_variable(speed_limit_, "vmax");
  }
}

int FixWallPlane::find_variable(const Quantity &quantity, const char *keyword)
{
  if (quantity.variable.empty()) return -1;
  std::string name = quantity.variable;
  const int index = input->variable->find(name.data());
  if (index < 0 || !input->variable->equalstyle(index))
    error->all(FLERR, (command() + ": servo " + keyword + " is v_" + name +
                       ", allowed: a number, or v_name of an equal-style variable").c_str());
  return index;
}

double FixWallPlane::value_of(const Quantity &quantity, const char *keyword)
{
  const int index = find_variable(quantity, keyword);
  return index < 0 ? quantity.number : input->variable->compute_equal(index);
}

void FixWallPlane::setup(int) { sum_contacts(); }

void FixWallPlane::initial_integrate(int)
{
  if (servo_) {
    modify->clearstep_compute();
    const double area = value_of(area_, "area");
    const double target = value_of(stress_, "stress") * area;
    const double limit = value_of(speed_limit_, "vmax");
    modify->addstep_compute(update->ntimestep + 1);
    if (!positive(area))
      error->all(FLERR, (command() + ": servo area is " + text_of(area) + ", allowed: above 0 (m2)").c_str());
    if (!positive(limit))
      error->all(FLERR, (command() + ": servo vmax is " + text_of(limit) + ", allowed: above 0 (m/s)").c_str());
    const auto speed = laws::servo_speed(gain_, target, state_[contact_force] + state_[fluid_force], stiffness_,
                                         state_[contacts], update->dt, limit);
    state_[velocity] = inward_ * speed.into_grains;
    if (speed.limited) state_[limited_steps] += 1.0;
  }
  state_[position] += state_[velocity] * update->dt;
}

void FixWallPlane::post_force(int)
{
  const double before = state_[contact_force];
  sum_contacts();
  const double into_grains = inward_ * state_[velocity] * update->dt;
  state_[work] += 0.5 * (before + state_[contact_force]) * into_grains;  // trapezoidal rule over the step
}

// As for neighbour lists: until the next one, grain and plane move by less than half of the skin each.
void FixWallPlane::list_near_grains()
{
  near_.clear();
  listed_position_ = state_[position];
  for (int i = 0; i < atom->nlocal; ++i) {
    if (!(atom->mask[i] & groupbit)) continue;
    if (atom->radius[i] - inward_ * (atom->x[i][axis_] - listed_position_) > -neighbor->skin) near_.push_back(i);
  }
}

void FixWallPlane::sum_contacts()
{
  double sums[2] = {0.0, 0.0};  // force on the grains, number of contacts
  double **const x = atom->x, **const v = atom->v, **const f = atom->f;
  const double at = state_[position], speed = state_[velocity];
  if (neighbor->ago == 0 || std::fabs(at - listed_position_) > 0.5 * neighbor->skin) list_near_grains();
  for (const int i : near_) {
    const double overlap = atom->radius[i] - inward_ * (x[i][axis_] - at);
    if (overlap <= 0.0) continue;
    const double dashpot = damping_ > 0.0 ? damping_ * atom->rmass[i] : 0.0;
    const double push = laws::plane_force(stiffness_, dashpot, overlap, inward_ * (speed - v[i][axis_]));
    f[i][axis_] += inward_ * push;
    sums[0] += push;
    sums[1] += 1.0;
  }
  double totals[2];
  MPI_Allreduce(sums, totals, 2, MPI_DOUBLE, MPI_SUM, world);
  state_[contact_force] = totals[0];
  state_[contacts] = totals[1];
}

void FixWallPlane::write_restart(FILE *file)
{
  if (comm->me != 0) return;
  const int bytes = sizeof state_;
  fwrite(&bytes, sizeof bytes, 1, file);
  fwrite(state_, sizeof state_, 1, file);
}

// Where the plane was and what it had done come from the restart file; how it moves, from the command.
void FixWallPlane::restart(char *data)
{
  if (reset_) return;
  const double commanded = state_[velocity];
  std::memcpy(state_, data, sizeof state_);
  if (!servo_) state_[velocity] = commanded;
  char text[160];
  snprintf(text, sizeof text, "%s: position %.9g m taken from the restart file (reset yes keeps the command's)",
           command().c_str(), state_[position]);
  error->message(FLERR, text);
}

}  // namespace poreslip
