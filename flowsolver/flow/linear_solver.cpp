#include "flow/linear_solver.hpp"

#include <HYPRE_parcsr_ls.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "flow/petsc_check.hpp"
#include "flow/petsc_options.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

// PETSc's own, in none of its headers.
extern "C" PetscErrorCode PCHYPREGetSolver(PC, HYPRE_Solver*);

namespace poreslip::flow {
namespace {

// The preconditioner at hand is kept while a solve takes no more than this share (and two) more iterations than its first.
constexpr double kept_share = 1.5;
constexpr int kept_extra = 2;

// It is carried over to a system of which at most one row in so many is new, or has a diagonal changed by more than this share.
constexpr std::int64_t carried_one_in = 50;
constexpr double changed_share = 0.2;

double elapsed(double since) { return MPI_Wtime() - since; }

// Multigrid's coarser matrices as two products, one after the other: on several ranks that takes less time than the three at once, HYPRE's
// default (benchmarks/flow_update/README.md). PETSc has no option for it.
void ask_for_two_products(KSP solver) {
  PC preconditioner = nullptr;
  const char* type = nullptr;
  check(KSPGetPC(solver, &preconditioner));
  check(PCHYPREGetType(preconditioner, &type));
  if (std::strcmp(type, "boomeramg") != 0) return;
  HYPRE_Solver multigrid = nullptr;
  check(PCHYPREGetSolver(preconditioner, &multigrid));
  HYPRE_BoomerAMGSetModuleRAP2(multigrid, 1);
}

}  // namespace

LinearSolver::LinearSolver(MPI_Comm comm, const std::string& options) : comm_(comm), options_(options) {
  start_petsc();
  use_options(options_);
}

LinearSolver::~LinearSolver() {
  PetscBool finalized = PETSC_FALSE;
  PetscFinalized(&finalized);
  if (finalized) return;
  carried_.reset();
  free_system();
  PCDestroy(&multigrid_);
  VecDestroy(&multigrid_like_);
}

void LinearSolver::free_system() {
  KSPDestroy(&solver_);
  destroy(matrices_);
  // An error may have come between taking it and giving it back.
  right_taken_ = false;
  VecDestroy(&right_);
  VecDestroy(&solution_);
}

void LinearSolver::make_solver() {
  check(KSPDestroy(&solver_));
  check(KSPCreate(comm_, &solver_));
  check(KSPSetOptionsPrefix(solver_, "flow_"));
  check_options(KSPSetFromOptions(solver_));
  PetscBool once = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(solver_), KSPPREONLY, &once));
  if (once)
    throw InputError("-flow_ksp_type preonly would take whatever a preconditioner gives, with no look at what is left: for a direct solver give "
                     "-flow_pc_type cholesky alone, which ends after an iteration or two");
  check(KSPSetInitialGuessNonzero(solver_, PETSC_TRUE));
}

void LinearSolver::begin(PetscInt rows, PetscInt all_rows) {
  carried_.reset();
  free_system();
  use_options(options_);
  all_rows_ = all_rows;
  entries_ = std::make_shared<Entries>();
  make_solver();
  check(KSPGetTolerances(solver_, nullptr, nullptr, nullptr, &most_iterations_));
  PC preconditioner = nullptr;
  PetscBool hypre = PETSC_FALSE;
  check(KSPGetPC(solver_, &preconditioner));
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(preconditioner), PCHYPRE, &hypre));
  // PETSc counts a row too many where HYPRE's matrix has none on a rank: it then makes a copy of its own for HYPRE.
  entries_->diagonal_first = hypre && !any_rank(comm_, rows == 0);
  check(VecCreateMPI(comm_, rows, all_rows, &right_));
  check(VecDuplicate(right_, &solution_));
}

PetscScalar* LinearSolver::right() {
  if (!right_taken_) check(VecGetArrayWrite(right_, &right_values_));
  right_taken_ = true;
  return right_values_;
}

// Whether, and how, the preconditioner at hand can be used for a system of another structure.
void LinearSolver::relate(const std::vector<PetscInt>& row_before) {
  const bool unrelated = stale_ || !multigrid_ || row_before.size() != entries_->rows();
  if (any_rank(comm_, unrelated)) {
    stale_ = true;
    return;
  }
  const auto diagonal = [](const Entries& entries, PetscInt row) { return entries.value[entries.diagonal(row)]; };
  std::vector<PetscInt> changed;
  const auto count = static_cast<PetscInt>(row_before.size());
  for (PetscInt k = 0; k < count; ++k) {
    const double earlier = row_before[k] < 0 ? 0.0 : diagonal(*multigrid_entries_, row_before[k]);
    if (std::abs(diagonal(*entries_, k) - earlier) > changed_share * earlier) changed.push_back(k);
  }
  std::int64_t rows[2] = {count, static_cast<std::int64_t>(changed.size())};
  MPI_Allreduce(MPI_IN_PLACE, rows, 2, MPI_INT64_T, MPI_SUM, comm_);
  if (rows[1] * carried_one_in > rows[0]) {
    stale_ = true;
    return;
  }
  carried_ = std::make_unique<CarriedPreconditioner>(solver_, matrices_.system, multigrid_, multigrid_like_, row_before, changed);
}

void LinearSolver::take(const SystemShape& shape, const std::vector<PetscInt>& row_before) {
  // On ranks without rows too, whose array is null: each has to know that norms of the vector are other ones now.
  if (right_taken_) check(VecRestoreArrayWrite(right_, &right_values_));
  right_taken_ = false;
  if (!matrices_.system) matrices_ = make_matrices(comm_, entries_, all_rows_);
  else if (shape.new_values) announce(matrices_);
  check(MatSetOption(matrices_.system, MAT_SPD, shape.singular ? PETSC_FALSE : PETSC_TRUE));
  MatNullSpace null_space = nullptr;
  if (shape.singular) check(MatNullSpaceCreate(comm_, PETSC_TRUE, 0, nullptr, &null_space));
  check(MatSetNullSpace(matrices_.system, null_space));
  if (shape.singular) check(MatNullSpaceRemove(null_space, right_));
  check(MatNullSpaceDestroy(&null_space));
  if (!shape.same_structure) relate(row_before);
}

LinearReport LinearSolver::solve(double relative_tolerance, double least_residual, const std::function<void(PetscScalar*)>& start) {
  LinearReport report;
  double clock = MPI_Wtime();
  use_options(options_);
  const Mat conditioned = matrices_.of_hypre ? matrices_.of_hypre : matrices_.system;
  check(KSPSetOperators(solver_, matrices_.system, conditioned));
  report.setup = elapsed(clock);
  for (bool again = true; again;) {
    clock = MPI_Wtime();
    const bool kept = !stale_;
    if (!kept && carried_) {
      // The solver's own preconditioner in place of the one that was carried over.
      carried_.reset();
      make_solver();
      check(KSPSetOperators(solver_, matrices_.system, conditioned));
    }
    if (!kept) {
      PCDestroy(&multigrid_);
      VecDestroy(&multigrid_like_);
      multigrid_entries_.reset();
      // Of PETSc's copy, which has a row too many, HYPRE cannot take them.
      if (matrices_.of_hypre) ask_for_two_products(solver_);
    }
    // A preconditioner that serves no longer gets little time. The start may be far off a small right side, as where given
    // pressures drop to 0: that is no divergence.
    check(KSPSetTolerances(solver_, relative_tolerance, least_residual, PETSC_MAX_REAL,
                           kept ? std::min(most_iterations_, 3 * iterations_at_setup_ + 20) : most_iterations_));
    check(KSPSetReusePreconditioner(solver_, kept ? PETSC_TRUE : PETSC_FALSE));
    check(KSPSetUp(solver_));
    report.setup += elapsed(clock);

    clock = MPI_Wtime();
    PetscScalar* unknown = nullptr;
    check(VecGetArrayWrite(solution_, &unknown));
    start(unknown);
    check(VecRestoreArrayWrite(solution_, &unknown));
    check(KSPSolve(solver_, right_, solution_));
    PetscInt iterations = 0;
    PetscReal residual = 0.0;
    check(KSPGetConvergedReason(solver_, &report.reason));
    check(KSPGetIterationNumber(solver_, &iterations));
    check(KSPGetResidualNorm(solver_, &residual));
    report.iterations += static_cast<int>(iterations);
    report.residual = residual;
    report.preconditioner_kept = kept;
    report.solve += elapsed(clock);
    if (!kept) {
      iterations_at_setup_ = static_cast<int>(iterations);
      check(KSPGetPC(solver_, &multigrid_));
      check(PetscObjectReference(reinterpret_cast<PetscObject>(multigrid_)));
      check(VecDuplicate(right_, &multigrid_like_));
      multigrid_entries_ = entries_;
    }
    stale_ = report.reason <= 0 || iterations > kept_share * iterations_at_setup_ + kept_extra;
    again = kept && report.reason <= 0;
  }
  return report;
}

void LinearSolver::read(const std::function<void(const PetscScalar*, const PetscScalar*)>& reader) const {
  const PetscScalar *right = nullptr, *solution = nullptr;
  check(VecGetArrayRead(right_, &right));
  check(VecGetArrayRead(solution_, &solution));
  reader(right, solution);
  check(VecRestoreArrayRead(solution_, &solution));
  check(VecRestoreArrayRead(right_, &right));
}

std::pair<PetscReal, PetscInt> LinearSolver::worst_row() const {
  Vec imbalance = nullptr;
  PetscInt worst = 0;
  PetscReal largest = 0.0;
  check(VecDuplicate(right_, &imbalance));
  check(KSPBuildResidual(solver_, nullptr, imbalance, &imbalance));
  check(VecAbs(imbalance));
  check(VecMax(imbalance, &worst, &largest));
  check(VecDestroy(&imbalance));
  return {largest, worst};
}

}  // namespace poreslip::flow
