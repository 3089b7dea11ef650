// Between two solves of the flow: what the pores' pressures answer to each step of the grains, and the forces of these pressures.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "geometry/facets.hpp"
#include "geometry/response_matrix.hpp"
#include "network/grain_directory.hpp"
#include "network/pore_network.hpp"
#include "network/volume_gradients.hpp"

namespace poreslip {

// Volumes swept by the grains and the forces on them come from the gradients of the pores' volumes where the grains were when
// the interval began. Collective. Grains may change their order and their rank within an interval.
class PoreResponse {
 public:
  explicit PoreResponse(PoreNetwork& network) : network_(network), gradients_(network) {}
  // Where its vectors are filled: only there are they known to be aligned more than others, which freeing must know as well.
  ~PoreResponse();
  PoreResponse(const PoreResponse&) = delete;
  PoreResponse& operator=(const PoreResponse&) = delete;

  // Starts an interval in the network's present state. pressure (pores), Pa; drift (pores), Pa/s: at which pressures change whatever
  // the grains do; stiffness (pores), Pa/m^3: 1 / (beta V) where a pressure answers the pore's volume, 0 where it does not.
  void begin(geometry::ForceLaw law, const double* pressure, const double* drift, const double* stiffness);

  // Ends the interval: no step is made before the next begins.
  void end() { begun_ = false; }

  // One step of `count` grains of this rank: by dt * velocity (count, 3), and of the walls by dt * wall_velocity (groups, 6),
  // outward. id (count,) in any order, or null on all ranks: that of the step before. In: the forces before the step, in the
  // present order; out: the forces after it (count, 3), and on the walls (groups, 6), outward, over all ranks.
  void step(double dt, std::size_t count, const std::int32_t* id, const double* velocity, const double* wall_velocity,
            double* force, double* wall_force);

  // Forces of the present pressures, in the order of the last step, or else of the network's last update.
  void forces(double* force, double* wall_force) const;

  // The same as step for a program that is not to know this class: null, or what went wrong on all ranks.
  static const char* step_for_engine(void* response, double dt, int count, const int* id, const double* velocity,
                                     const double* wall_velocity, double* force, double* wall_force);

  std::size_t grains() const { return directory_.input_size(); }
  std::size_t groups() const { return wall_before_.size() / 6; }
  double elapsed() const { return elapsed_; }                          // s, since the interval began
  std::vector<double> pressure() const;                                // (pores), Pa
  const std::vector<double>& swept() const;                            // (pores), m^3: volumes gained since then
  // Of this rank, J: done on grains and walls by the mean of the forces before and after each step; given by the fluid; and
  // the sizes of the first's terms.
  std::array<double, 3> work() const;
  double seconds() const { return seconds_; }                          // of this rank, that all steps took

 private:
  void take_order(std::size_t count, const std::int32_t* id);
  void spread(double dt, const double* velocity);
  void collect(double* out) const;
  double pressure_at(std::size_t cell) const { return start_[cell] + elapsed_ * drift_[cell] - stiffness_[cell] * swept_[cell]; }
  void begin_by_matrix();
  void move(double dt, const double* velocity, const double* wall_velocity);
  // Force on a body at the start, of drift, and of its own displacement, N.
  geometry::Four apart(std::size_t i) const { return first_[i] + elapsed_ * drifting_[i] + matrix_.own(i, displacement_[i]); }
  void add_mutual(double* wall_force) const;
  void work_alone(double* force);
  std::size_t entries_of(std::size_t grain) const { return 3 * static_cast<std::size_t>(input_of_local_[grain]); }
  void add_work(double dt, std::size_t size, const double* before, const double* after, const double* speed);
  std::size_t entry(const geometry::Roof& roof) const { return static_cast<std::size_t>(roof.body) - network_.local_grains().size() - 1; }
  double answer_by_cells(double dt, const double* wall_velocity);
  void sum_roofs(const std::vector<double>& pressure, double* wall_force) const;

  PoreNetwork& network_;
  GrainDirectory directory_;
  std::vector<std::int32_t> id_;                 // the caller's order; empty: that of the network's last update
  std::vector<std::int32_t> input_of_local_;     // where alone: place in the caller's order
  VolumeGradients gradients_;                    // where the interval began
  std::vector<double> start_, drift_, stiffness_;
  mutable std::vector<double> gained_;
  mutable std::vector<double> swept_;
  std::vector<geometry::Four> displacement_;
  mutable std::vector<geometry::Four> force_;
  std::vector<double> before_, wall_before_;     // forces before the step
  // Where forces are the gradients of the volumes all follows from the displacements since the interval began: displacement_, with those of the
  // walls' entries behind the grains. Each rank's matrix is of the cells that it owns; what that says of other ranks' grains, and of images, is
  // added to them.
  bool by_matrix_ = false;
  bool alone_ = false;                           // one rank whose every local grain is one of the caller's
  geometry::ResponseMatrix matrix_;
  bool connected_ = false;                       // the matrix connects the bodies that the gradients do
  std::vector<geometry::Four> way_;              // of the last step, m, of grains; of the walls' entries too where by_matrix_
  std::vector<geometry::Four> first_, drifting_; // forces when the interval began, N, and what drift adds to them, N/s
  double drifted_ = 0.0;                         // sum over the steps of their middle times drifting_ . way_, J
  mutable bool swept_known_ = true;
  bool begun_ = false;
  double elapsed_ = 0.0;
  std::array<double, 3> work_{};
  double seconds_ = 0.0;
  std::string message_;
};

}  // namespace poreslip
