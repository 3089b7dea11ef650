#include "flow/pore_flow.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "flow/rows.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"
#include "tessellation/errors.hpp"

namespace poreslip::flow {
namespace {

// Of the right side's terms, in the norm of the residual.
constexpr double rounding = 4e-16;

double elapsed(double since) { return MPI_Wtime() - since; }

std::string number_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

}  // namespace

PoreFlow::PoreFlow(PoreNetwork& network, const Fluid& fluid, ConductanceLaw law, const Limiter& limiter,
                   const std::string& options)
    : network_(network), fluid_(fluid), law_(law), limiter_(limiter), comm_(network.communicator()), solver_(comm_, options) {}

void PoreFlow::refresh(const double* body_force) {
  if (!network_.meshed()) throw InputError("the network has no pores: update it first, with grains of which a mesh can be made");
  follow_mesh();
  throats_ = make_throats(network_, fluid_, law_, limiter_, body_force);
  numbered_throats_ = false;
  assembled_dt_ = -1.0;
  storage_ = storage(network_, fluid_, limiter_, limited_pores_);
  network_.exchange();
}

void PoreFlow::require_current() const {
  if (mesh_followed_ != network_.mesh_number())
    throw InputError("the network was meshed anew since the flow was last refreshed: call refresh() after each update");
}

// Where the preconditioner's unknowns are in the present mesh.
void PoreFlow::follow_mesh() {
  const std::int64_t number = network_.mesh_number();
  if (number == mesh_followed_) return;
  const std::vector<std::int32_t>& previous = network_.mesh().previous;
  std::vector<PetscInt> row;
  if (number == mesh_followed_ + 1 && !previous.empty() && !row_at_setup_.empty()) {
    row.reserve(previous.size());
    for (const std::int32_t c : previous) row.push_back(c < 0 ? -1 : row_at_setup_[c]);
  }
  row_at_setup_ = std::move(row);
  mesh_followed_ = number;
}

void PoreFlow::set_conductance(const double* conductance) {
  for (std::size_t f = 0; f < throats_.conductance.size(); ++f)
    if (throats_.owned[f]) throats_.conductance[f] = *conductance++;
  numbered_throats_ = false;
  assembled_dt_ = -1.0;
  solver_.forget_preconditioner();
}

std::vector<double> PoreFlow::conductance() const {
  std::vector<double> owned;
  for (std::size_t f = 0; f < throats_.conductance.size(); ++f)
    if (throats_.owned[f]) owned.push_back(throats_.conductance[f]);
  return owned;
}

// Mean pressure of a sealed box after dt, from the balance of all its pores together; weighted with the storage if there is any.
double PoreFlow::sealed_mean(const Conditions& conditions, bool stored, double dt) const {
  double sums[2] = {0.0, 0.0};
  for (const std::int32_t c : free_) {
    const double weight = stored ? storage_[c] : 1.0;
    sums[0] += weight * conditions.pressure[c];
    if (stored) sums[0] += dt * (conditions.source[c] - conditions.volume_rate[c]);
    sums[1] += weight;
  }
  MPI_Allreduce(MPI_IN_PLACE, sums, 2, MPI_DOUBLE, MPI_SUM, comm_);
  return sums[0] / sums[1];
}

// Plain mean of the given pressures.
double PoreFlow::given_mean(const Conditions& conditions) const {
  double sums[2] = {0.0, 0.0};
  for (std::size_t c = 0; c < network_.pores(); ++c) {
    if (!network_.owned()[c] || fixed_[c] == 0) continue;
    sums[0] += conditions.pressure[c];
    sums[1] += 1.0;
  }
  MPI_Allreduce(MPI_IN_PLACE, sums, 2, MPI_DOUBLE, MPI_SUM, comm_);
  return sums[0] / sums[1];
}

// Names the pore with the largest imbalance, on the rank that has it.
void PoreFlow::report_divergence(const SolveReport& report) const {
  const auto [largest, worst] = solver_.worst_row();
  const bool overflown = report.reason == KSP_DIVERGED_NANORINF;
  // Where not a number is to be compared, no row is the worst: then it is everybody's.
  const bool here = worst >= first_row_ && worst < first_row_ + static_cast<PetscInt>(free_.size());
  std::string fault;
  if (here || overflown || worst < 0) {
    char text[400] = "";
    if (here) {
      std::vector<double> centre(3 * network_.pores());
      network_.pore_centre(centre.data());
      const double* p = &centre[3 * free_[worst - first_row_]];
      std::snprintf(text, sizeof text, ", worst pore at (%.9g, %.9g, %.9g) m out of balance by %g m^3/s", p[0], p[1], p[2], largest);
    }
    fault = "the linear solver did not converge (" + std::string(KSPConvergedReasons[report.reason]) + ") after " + std::to_string(report.iterations) +
            " iterations: residual " + number_text(report.residual) + (overflown ? "" : text) + "; " +
            (overflown                                     ? "flows are too large for the computer's numbers: look at the units of viscosity, pressures and box"
             : report.reason == KSP_DIVERGED_INDEFINITE_PC ? "the preconditioner fails, as multigrid may where conductances are too unlike: take another "
                                                             "(-flow_pc_type jacobi), or a larger tolerance"
                                                           : "allow more iterations (-flow_ksp_max_it) or a larger tolerance");
  }
  agree_on_computation(comm_, fault);
}

SolveReport PoreFlow::solve(const Conditions& conditions, double dt, double relative_tolerance, double* pressure) {
  require_current();
  SolveReport report{};
  double clock = MPI_Wtime();
  const std::size_t n = network_.pores();
  const bool stored = dt > 0.0 && fluid_.compressibility > 0.0;
  number(conditions.fixed, stored);
  std::copy_n(conditions.pressure, n, pressure);
  report.unknowns = all_rows_;
  report.limited_pores = sum(comm_, limited_pores_);
  report.limited_throats = sum(comm_, throats_.limited);
  if (all_rows_ == 0) {
    network_.exchange().fetch(pressure);
    return report;
  }
  // The solver is left with the deviation from a reference pressure, so that its tolerance is one of what drives the flow. In a
  // sealed box that is the mean pressure, which is known beforehand; else the mean of the given pressures.
  const bool sealed = sealed_;
  const double reference = sealed ? sealed_mean(conditions, stored, dt) : given_mean(conditions);
  const double start_reference = sealed ? sealed_mean(conditions, stored, 0.0) : reference;
  const bool same_structure = structured_;
  if (!same_structure) solver_.begin(static_cast<PetscInt>(free_.size()), all_rows_);
  const bool stands = same_structure && !any_rank(comm_, assembled_dt_ != std::max(dt, 0.0));
  assembled_dt_ = -1.0;
  network_.exchange().fetch(pressure);
  const Sums own = assemble(conditions, pressure, dt, reference, !same_structure, !stands);
  double net[4] = {own.right, own.terms, own.squares, matrix_sum_};
  const auto isolated = static_cast<std::int64_t>(isolated_.size());
  report.isolated = sum(comm_, isolated) + cut_off_;
  MPI_Allreduce(MPI_IN_PLACE, net, 4, MPI_DOUBLE, MPI_SUM, comm_);
  const bool singular = sealed && !stored;
  if (singular) {
    std::string fault;
    if (std::abs(net[0]) > 1e-9 * net[1]) {
      char text[240];
      std::snprintf(text, sizeof text,
                    "no pressure is given anywhere, nothing is stored, and the sources do not balance: they sum to %g m^3/s; give "
                    "a pressure at a face or pore, or sources that sum to zero", net[0]);
      fault = text;
    }
    agree_on_input(comm_, fault);
  }

  std::vector<PetscInt> row_before;
  if (!same_structure && !row_at_setup_.empty()) {
    row_before.reserve(free_.size());
    for (const std::int32_t c : free_) row_before.push_back(row_at_setup_[c]);
  }
  solver_.take({singular, same_structure, !stands}, row_before);
  structured_ = true;
  assembled_dt_ = std::max(dt, 0.0);
  report.assemble = elapsed(clock);

  const double* const first = conditions.start ? conditions.start : conditions.pressure;
  // Below the rounding of its own terms a residual means nothing.
  const LinearReport linear = solver_.solve(relative_tolerance, rounding * std::sqrt(net[2]), [&](PetscScalar* unknown) {
    for (std::size_t k = 0; k < free_.size(); ++k) unknown[k] = first[free_[k]] - start_reference;
  });
  report.iterations = linear.iterations;
  report.reason = static_cast<int>(linear.reason);
  report.residual = linear.residual;
  report.preconditioner_kept = linear.preconditioner_kept;
  report.setup = linear.setup;
  report.solve = linear.solve;
  if (!linear.preconditioner_kept) {
    row_at_setup_.assign(n, -1);
    for (std::size_t k = 0; k < free_.size(); ++k) row_at_setup_[free_[k]] = static_cast<PetscInt>(k);
  }
  if (linear.reason <= 0) report_divergence(report);
  double shift = 0.0;
  if (!sealed) {
    // One shift of all unknowns closes the balance of all pores together, whatever tolerance the solver had; the error in the energy norm falls.
    double missing = 0.0;
    solver_.read([&](const PetscScalar* right, const PetscScalar* unknown) {
      // The residual's sum; couplings between unknowns cancel in it.
      auto edge = edges_.begin();
      for (std::size_t k = 0; k < free_.size(); ++k) {
        missing += right[k];
        if (stored) missing -= storage_[free_[k]] / dt * unknown[k];
        if (edge != edges_.end() && edge->row == static_cast<PetscInt>(k)) missing -= edge++->conductance * unknown[k];
      }
    });
    MPI_Allreduce(MPI_IN_PLACE, &missing, 1, MPI_DOUBLE, MPI_SUM, comm_);
    report.imbalance = std::abs(missing);
    shift = missing / net[3];
  }
  solver_.read([&](const PetscScalar*, const PetscScalar* unknown) {
    for (std::size_t k = 0; k < free_.size(); ++k) pressure[free_[k]] = reference + shift + unknown[k];
  });
  if (sealed) {
    // The deviation's own mean is zero; what the solver's tolerance has left of it is taken off.
    double drift[2] = {0.0, 0.0};
    for (const std::int32_t c : free_) {
      const double weight = stored ? storage_[c] : 1.0;
      drift[0] += weight * pressure[c];
      drift[1] += weight;
    }
    MPI_Allreduce(MPI_IN_PLACE, drift, 2, MPI_DOUBLE, MPI_SUM, comm_);
    for (const std::int32_t c : free_) pressure[c] += reference - drift[0] / drift[1];
  }
  network_.exchange().fetch(pressure);
  return report;
}

}  // namespace poreslip::flow
