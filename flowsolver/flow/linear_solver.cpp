#include "flow/linear_solver.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "flow/petsc_check.hpp"
#include "flow/petsc_options.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip::flow {
namespace {

// The preconditioner at hand is kept while a solve takes no more than this share (and two) more iterations than its first.
constexpr double kept_share = 1.5;
constexpr int kept_extra = 2;

// It is carried over to a system of which at most one row in so many is new, or has a diagonal changed by more than this share.
constexpr std::int64_t carried_one_in = 50;
constexpr double changed_share = 0.2;

double elapsed(double since) { return MPI_Wtime() - since; }

void fill(Vec vector, const std::vector<double>& value) {
  PetscScalar* v = nullptr;
  check(VecGetArrayWrite(vector, &v));
  std::copy(value.begin(), value.end(), v);
  check(VecRestoreArrayWrite(vector, &v));
}

// The matrix is made of the arrays as they are; they live as long as it does.
Mat matrix_of(MPI_Comm comm, Entries* entries, PetscInt all_rows) {
  Mat matrix = nullptr;
  PetscContainer container = nullptr;
  const auto rows = static_cast<PetscInt>(entries->start.size() - 1);
  PetscScalar* const value = entries->value.data();
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  check(PetscContainerCreate(comm, &container));
  check(PetscContainerSetPointer(container, entries));
  check(PetscContainerSetUserDestroy(container, [](void* p) -> PetscErrorCode {
    delete static_cast<Entries*>(p);
    return 0;
  }));
  if (ranks == 1)
    check(MatCreateSeqAIJWithArrays(comm, rows, rows, entries->start.data(), entries->column.data(), value, &matrix));
  else
    check(MatCreateMPIAIJWithSplitArrays(comm, rows, rows, all_rows, all_rows, entries->start.data(), entries->column.data(), value,
                                         entries->other_start.data(), entries->other_column.data(), value + entries->column.size(), &matrix));
  check(PetscObjectCompose(reinterpret_cast<PetscObject>(matrix), "entries", reinterpret_cast<PetscObject>(container)));
  check(PetscContainerDestroy(&container));
  return matrix;
}

// Tells PETSc that the values in its arrays are other ones.
void announce(Mat matrix) {
  Mat own = matrix, other = nullptr;
  PetscBool serial = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(matrix), MATSEQAIJ, &serial));
  if (!serial) check(MatMPIAIJGetSeqAIJ(matrix, &own, &other, nullptr));
  for (Mat part : {own, other}) {
    if (!part) continue;
    PetscScalar* value = nullptr;
    check(MatSeqAIJGetArrayWrite(part, &value));
    check(MatSeqAIJRestoreArrayWrite(part, &value));
  }
  check(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY));
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
  MatDestroy(&matrix_);
  VecDestroy(&right_);
  VecDestroy(&solution_);
}

void LinearSolver::make(Entries&& entries, PetscInt all_rows) {
  carried_.reset();
  free_system();
  use_options(options_);
  entries_ = new Entries(std::move(entries));
  const auto local = static_cast<PetscInt>(entries_->diagonal.size());
  matrix_ = matrix_of(comm_, entries_, all_rows);
  check(VecCreateMPI(comm_, local, all_rows, &right_));
  check(VecDuplicate(right_, &solution_));
  check(KSPCreate(comm_, &solver_));
  check(KSPSetOptionsPrefix(solver_, "flow_"));
  check_options(KSPSetFromOptions(solver_));
  check(KSPSetInitialGuessNonzero(solver_, PETSC_TRUE));
  check(KSPGetTolerances(solver_, nullptr, nullptr, nullptr, &most_iterations_));
}

// Whether, and how, the preconditioner at hand can be used for a system of another structure.
void LinearSolver::relate(const std::vector<PetscInt>& row_before) {
  const bool unrelated = stale_ || !multigrid_ || row_before.size() != diagonal_.size();
  if (any_rank(comm_, unrelated)) {
    stale_ = true;
    return;
  }
  std::vector<PetscInt> changed;
  for (std::size_t k = 0; k < diagonal_.size(); ++k) {
    const double earlier = row_before[k] < 0 ? 0.0 : multigrid_diagonal_[row_before[k]];
    if (std::abs(diagonal_[k] - earlier) > changed_share * earlier) changed.push_back(static_cast<PetscInt>(k));
  }
  std::int64_t rows[2] = {static_cast<std::int64_t>(diagonal_.size()), static_cast<std::int64_t>(changed.size())};
  MPI_Allreduce(MPI_IN_PLACE, rows, 2, MPI_INT64_T, MPI_SUM, comm_);
  if (rows[1] * carried_one_in > rows[0]) {
    stale_ = true;
    return;
  }
  carried_ = std::make_unique<CarriedPreconditioner>(solver_, matrix_, multigrid_, multigrid_like_, row_before, changed);
}

void LinearSolver::take(const std::vector<double>& right, const SystemShape& shape, const std::vector<PetscInt>& row_before) {
  if (shape.new_values) {
    announce(matrix_);
    diagonal_.resize(right.size());
    for (std::size_t k = 0; k < right.size(); ++k) diagonal_[k] = entries_->value[entries_->diagonal[k]];
  }
  check(MatSetOption(matrix_, MAT_SPD, shape.singular ? PETSC_FALSE : PETSC_TRUE));
  MatNullSpace null_space = nullptr;
  if (shape.singular) check(MatNullSpaceCreate(comm_, PETSC_TRUE, 0, nullptr, &null_space));
  check(MatSetNullSpace(matrix_, null_space));
  fill(right_, right);
  if (shape.singular) check(MatNullSpaceRemove(null_space, right_));
  check(MatNullSpaceDestroy(&null_space));
  if (!shape.same_structure) relate(row_before);
}

LinearReport LinearSolver::solve(double relative_tolerance, double least_residual, std::vector<double>& unknown) {
  LinearReport report;
  double clock = MPI_Wtime();
  use_options(options_);
  check(KSPSetOperators(solver_, matrix_, matrix_));
  report.setup = elapsed(clock);
  for (bool again = true; again;) {
    clock = MPI_Wtime();
    const bool kept = !stale_;
    if (!kept && carried_) {
      // The solver's own preconditioner in place of the one that was carried over.
      carried_.reset();
      check(KSPDestroy(&solver_));
      check(KSPCreate(comm_, &solver_));
      check(KSPSetOptionsPrefix(solver_, "flow_"));
      check_options(KSPSetFromOptions(solver_));
      check(KSPSetInitialGuessNonzero(solver_, PETSC_TRUE));
      check(KSPSetOperators(solver_, matrix_, matrix_));
    }
    if (!kept) {
      PCDestroy(&multigrid_);
      VecDestroy(&multigrid_like_);
    }
    // A preconditioner that serves no longer gets little time. The start may be far off a small right side, as where given
    // pressures drop to 0: that is no divergence.
    check(KSPSetTolerances(solver_, relative_tolerance, least_residual, PETSC_MAX_REAL,
                           kept ? std::min(most_iterations_, 3 * iterations_at_setup_ + 20) : most_iterations_));
    check(KSPSetReusePreconditioner(solver_, kept ? PETSC_TRUE : PETSC_FALSE));
    check(KSPSetUp(solver_));
    report.setup += elapsed(clock);

    clock = MPI_Wtime();
    fill(solution_, unknown);
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
      multigrid_diagonal_ = diagonal_;
    }
    stale_ = report.reason <= 0 || iterations > kept_share * iterations_at_setup_ + kept_extra;
    again = kept && report.reason <= 0;
  }
  const PetscScalar* found = nullptr;
  check(VecGetArrayRead(solution_, &found));
  std::copy_n(found, unknown.size(), unknown.begin());
  check(VecRestoreArrayRead(solution_, &found));
  return report;
}

double LinearSolver::residual_sum() const {
  Vec residual = nullptr;
  PetscScalar sum = 0.0;
  check(VecDuplicate(right_, &residual));
  check(MatMult(matrix_, solution_, residual));
  check(VecAYPX(residual, -1.0, right_));
  check(VecSum(residual, &sum));
  check(VecDestroy(&residual));
  return sum;
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
