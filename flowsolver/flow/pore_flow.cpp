#include "flow/pore_flow.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "flow/petsc_check.hpp"
#include "flow/rows.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip::flow {
namespace {

// The preconditioner at hand is kept while a solve takes no more than this share (and two) more iterations than its first.
constexpr double kept_share = 1.5;
constexpr int kept_extra = 2;

// Of the right side's terms, in the norm of the residual.
constexpr double rounding = 4e-16;

// The tuned multigrid, unless the user's options say otherwise.
constexpr std::array<std::array<const char*, 2>, 11> default_options{{
    {"-flow_ksp_type", "cg"},
    {"-flow_ksp_norm_type", "unpreconditioned"},
    {"-flow_pc_type", "hypre"},
    {"-flow_pc_hypre_type", "boomeramg"},
    {"-flow_pc_hypre_boomeramg_coarsen_type", "PMIS"},
    {"-flow_pc_hypre_boomeramg_interp_type", "ext+i"},
    {"-flow_pc_hypre_boomeramg_P_max", "4"},
    {"-flow_pc_hypre_boomeramg_strong_threshold", "0.5"},
    {"-flow_pc_hypre_boomeramg_agg_nl", "1"},
    // Relaxing coarse and fine points in turn takes each sweep twice through the matrix and saves no iteration.
    {"-flow_pc_hypre_boomeramg_no_CF", "1"},
    // Elimination on the coarsest level fails where only differences of pressure are determined.
    {"-flow_pc_hypre_boomeramg_relax_type_coarse", "symmetric-SOR/Jacobi"},
}};

void start_petsc(const std::string& options) {
  PetscBool started = PETSC_FALSE;
  check(PetscInitialized(&started));
  if (!started) {
    check(PetscInitializeNoArguments());
    // The host program keeps its own signal handlers.
    check(PetscPopSignalHandler());
  }
  check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr));
  check(PetscOptionsInsertString(nullptr, options.c_str()));
  for (const auto& [name, value] : default_options) {
    PetscBool given = PETSC_FALSE;
    check(PetscOptionsHasName(nullptr, nullptr, name, &given));
    if (!given) check(PetscOptionsSetValue(nullptr, name, value));
  }
}

double elapsed(double since) { return MPI_Wtime() - since; }

}  // namespace

PoreFlow::PoreFlow(PoreNetwork& network, const Fluid& fluid, ConductanceLaw law, const Limiter& limiter,
                   const std::string& options)
    : network_(network), fluid_(fluid), law_(law), limiter_(limiter), comm_(network.communicator()) {
  start_petsc(options);
}

PoreFlow::~PoreFlow() {
  PetscBool finalized = PETSC_FALSE;
  PetscFinalized(&finalized);
  if (!finalized) free_petsc();
}

void PoreFlow::free_petsc() {
  KSPDestroy(&solver_);
  MatDestroy(&matrix_);
  VecDestroy(&right_);
  VecDestroy(&solution_);
}

void PoreFlow::refresh(const double* body_force) {
  throats_ = make_throats(network_, fluid_, law_, limiter_, body_force);
  storage_ = storage(network_, fluid_, limiter_, limited_pores_);
  network_.exchange();
}

void PoreFlow::set_conductance(const double* conductance) {
  throats_.conductance.assign(conductance, conductance + throats_.facet.size());
  preconditioner_stale_ = true;
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
    if (!network_.owned()[c] || fixed_[c] == 0.0) continue;
    sums[0] += conditions.pressure[c];
    sums[1] += 1.0;
  }
  MPI_Allreduce(MPI_IN_PLACE, sums, 2, MPI_DOUBLE, MPI_SUM, comm_);
  return sums[0] / sums[1];
}

SolveReport PoreFlow::solve(const Conditions& conditions, double dt, double relative_tolerance, double* pressure) {
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
  const bool sealed = sum(comm_, std::count(network_.owned(), network_.owned() + n, true)) == all_rows_;
  const double reference = sealed ? sealed_mean(conditions, stored, dt) : given_mean(conditions);
  const double start_reference = sealed ? sealed_mean(conditions, stored, 0.0) : reference;
  Rows rows;
  assemble(conditions, dt, reference, rows);

  // A pore without any open throat, where nothing is stored and no pressure is given.
  std::int64_t isolated = 0;
  double net[3] = {0.0, 0.0, 0.0};  // sums of the right sides and of their terms; square of the terms' scale
  for (const std::int32_t c : free_) {
    net[0] += rows.right[c];
    net[1] += rows.terms[c];
    const double scale = rows.terms[c] + rows.diagonal[c] * std::max(std::abs(conditions.pressure[c]), std::abs(reference));
    net[2] += scale * scale;
    if (rows.diagonal[c] > 0.0) continue;
    ++isolated;
    rows.diagonal[c] = 1.0;
    rows.right[c] = conditions.pressure[c] - reference;
  }
  report.isolated = sum(comm_, isolated) + cut_off_;
  MPI_Allreduce(MPI_IN_PLACE, net, 3, MPI_DOUBLE, MPI_SUM, comm_);
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

  std::vector<PetscInt> start{0}, columns;
  std::vector<PetscScalar> values;
  columns.reserve(5 * free_.size());
  values.reserve(5 * free_.size());
  for (std::size_t k = 0; k < free_.size(); ++k) {
    const std::int32_t c = free_[k];
    std::array<std::pair<PetscInt, double>, 5> entry;
    int count = 0;
    entry[count++] = {first_row_ + static_cast<PetscInt>(k), rows.diagonal[c]};
    for (int e = 0; e < rows.filled[c]; ++e) entry[count++] = {rows.column[c][e], rows.value[c][e]};
    std::sort(entry.begin(), entry.begin() + count);
    for (int e = 0; e < count; ++e) {
      columns.push_back(entry[e].first);
      values.push_back(entry[e].second);
    }
    start.push_back(static_cast<PetscInt>(columns.size()));
  }
  const bool same_structure = matrix_ && !any_rank(comm_, matrix_mesh_ != network_.mesh_number() || matrix_fixed_ != fixed_);
  if (!same_structure) {
    free_petsc();
    const PetscInt local = static_cast<PetscInt>(free_.size());
    check(MatCreate(comm_, &matrix_));
    check(MatSetSizes(matrix_, local, local, all_rows_, all_rows_));
    check(MatSetType(matrix_, MATAIJ));
    check(VecCreateMPI(comm_, local, all_rows_, &right_));
    check(VecDuplicate(right_, &solution_));
    check(KSPCreate(comm_, &solver_));
    check(KSPSetOptionsPrefix(solver_, "flow_"));
    check(KSPSetFromOptions(solver_));
    check(KSPSetInitialGuessNonzero(solver_, PETSC_TRUE));
    check(KSPGetTolerances(solver_, nullptr, nullptr, nullptr, &most_iterations_));
    matrix_mesh_ = network_.mesh_number();
    matrix_fixed_ = fixed_;
    preconditioner_stale_ = true;
  }
  check(MatSeqAIJSetPreallocationCSR(matrix_, start.data(), columns.data(), values.data()));
  check(MatMPIAIJSetPreallocationCSR(matrix_, start.data(), columns.data(), values.data()));
  check(MatSetOption(matrix_, MAT_SPD, singular ? PETSC_FALSE : PETSC_TRUE));
  MatNullSpace null_space = nullptr;
  if (singular) check(MatNullSpaceCreate(comm_, PETSC_TRUE, 0, nullptr, &null_space));
  check(MatSetNullSpace(matrix_, null_space));
  PetscScalar* b = nullptr;
  check(VecGetArray(right_, &b));
  for (std::size_t k = 0; k < free_.size(); ++k) b[k] = rows.right[free_[k]];
  check(VecRestoreArray(right_, &b));
  // The multigrid needs the memory more than these do.
  rows = {};
  std::vector<PetscInt>().swap(start);
  std::vector<PetscInt>().swap(columns);
  std::vector<PetscScalar>().swap(values);
  if (singular) check(MatNullSpaceRemove(null_space, right_));
  check(MatNullSpaceDestroy(&null_space));
  report.assemble = elapsed(clock);

  clock = MPI_Wtime();
  check(KSPSetOperators(solver_, matrix_, matrix_));
  report.setup = elapsed(clock);
  KSPConvergedReason reason;
  for (bool again = true; again;) {
    clock = MPI_Wtime();
    const bool kept = !preconditioner_stale_;
    // Below the rounding of its own terms a residual means nothing. A preconditioner that serves no longer gets little time.
    // The start may be far off a small right side, as where given pressures drop to 0: that is no divergence.
    check(KSPSetTolerances(solver_, relative_tolerance, rounding * std::sqrt(net[2]), PETSC_MAX_REAL,
                           kept ? std::min(most_iterations_, 3 * iterations_at_setup_ + 20) : most_iterations_));
    check(KSPSetReusePreconditioner(solver_, kept ? PETSC_TRUE : PETSC_FALSE));
    check(KSPSetUp(solver_));
    report.setup += elapsed(clock);

    clock = MPI_Wtime();
    PetscScalar* x = nullptr;
    check(VecGetArray(solution_, &x));
    for (std::size_t k = 0; k < free_.size(); ++k) x[k] = conditions.pressure[free_[k]] - start_reference;
    check(VecRestoreArray(solution_, &x));
    check(KSPSolve(solver_, right_, solution_));
    PetscInt iterations = 0;
    PetscReal residual = 0.0;
    check(KSPGetConvergedReason(solver_, &reason));
    check(KSPGetIterationNumber(solver_, &iterations));
    check(KSPGetResidualNorm(solver_, &residual));
    report.iterations += static_cast<int>(iterations);
    report.reason = static_cast<int>(reason);
    report.residual = residual;
    report.preconditioner_kept = kept;
    report.solve += elapsed(clock);
    if (!kept) iterations_at_setup_ = static_cast<int>(iterations);
    preconditioner_stale_ = reason <= 0 || iterations > kept_share * iterations_at_setup_ + kept_extra;
    again = kept && reason <= 0;
  }

  const PetscScalar* found = nullptr;
  check(VecGetArrayRead(solution_, &found));
  for (std::size_t k = 0; k < free_.size(); ++k) pressure[free_[k]] = reference + found[k];
  check(VecRestoreArrayRead(solution_, &found));
  if (reason <= 0) {
    // The pore with the largest imbalance, on the rank that has it.
    Vec imbalance;
    check(VecDuplicate(right_, &imbalance));
    check(KSPBuildResidual(solver_, nullptr, imbalance, &imbalance));
    PetscInt worst = 0;
    PetscReal largest = 0.0;
    check(VecAbs(imbalance));
    check(VecMax(imbalance, &worst, &largest));
    check(VecDestroy(&imbalance));
    std::string fault;
    if (worst >= first_row_ && worst < first_row_ + static_cast<PetscInt>(free_.size())) {
      std::vector<double> centre(3 * n);
      network_.pore_centre(centre.data());
      const double* p = &centre[3 * free_[worst - first_row_]];
      char text[320];
      std::snprintf(text, sizeof text,
                    "the linear solver did not converge (%s) after %d iterations: residual %g, worst pore at (%.9g, %.9g, %.9g) m "
                    "out of balance by %g m^3/s; allow more iterations (-flow_ksp_max_it) or a larger tolerance",
                    KSPConvergedReasons[reason], report.iterations, report.residual, p[0], p[1], p[2], largest);
      fault = text;
    }
    agree_on_computation(comm_, fault);
  }
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
