// fix ID group wall/plane normal NX NY NZ position P kn K [gamman G] velocity V
// fix ID group wall/plane normal NX NY NZ position P kn K [gamman G] servo stress S area A gain C vmax V
#pragma once

#include <string>
#include <vector>

#include "fix.h"

namespace poreslip {

// Rigid frictionless plane across one axis, on its group's grains only, moved at a set velocity or by
// a servo that holds contact force + fluid force at stress * area.
class FixWallPlane : public LAMMPS_NS::Fix {
 public:
  enum StateColumn { position, velocity, contact_force, fluid_force, contacts, work, limited_steps, state_columns };

  FixWallPlane(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  int setmask() override;
  void init() override;
  void setup(int vflag) override;
  void initial_integrate(int vflag) override;
  void post_force(int vflag) override;
  int modify_param(int narg, char **arg) override;
  double compute_vector(int column) override { return state_[column]; }
  void write_restart(FILE *file) override;
  void restart(char *data) override;

  void set_fluid_force(double force) { state_[fluid_force] = force; }
  const double *state() const { return state_; }

 private:
  // A number, or the value of an equal-style variable (v_name).
  struct Quantity {
    double number = 0.0;
    std::string variable;
  };

  Quantity read_quantity(class Arguments &arguments, const std::string &keyword);
  void read_servo(Arguments &arguments);
  void read_velocity(Arguments &arguments);
  int find_variable(const Quantity &quantity, const char *keyword);
  double value_of(const Quantity &quantity, const char *keyword);
  void list_near_grains();
  void sum_contacts();
  std::string command() const;

  int axis_ = 0;
  double inward_ = 1.0;  // +1: the grains are on the side of larger coordinates
  double stiffness_ = 0.0;
  double damping_ = 0.0;  // 1/s, times the grain's mass
  bool servo_ = false;
  Quantity stress_, area_, speed_limit_;
  double gain_ = 0.0;
  bool reset_ = false;
  double state_[state_columns] = {};
  std::vector<int> near_;        // own grains that can touch before the next neighbour list
  double listed_position_ = 0.0;
};

}  // namespace poreslip
