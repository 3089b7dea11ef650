#include "flow/carried_preconditioner.hpp"

#include <algorithm>

#include "flow/petsc_check.hpp"

namespace poreslip::flow {

CarriedPreconditioner::CarriedPreconditioner(KSP solver, Mat matrix, PC earlier, Vec earlier_like,
                                             const std::vector<PetscInt>& row_before, const std::vector<PetscInt>& changed)
    : earlier_(earlier), row_before_(row_before) {
  check(PetscObjectReference(reinterpret_cast<PetscObject>(earlier_)));
  check(PCSetReusePreconditioner(earlier_, PETSC_TRUE));
  check(VecDuplicate(earlier_like, &right_));
  check(VecDuplicate(earlier_like, &solution_));
  // Rows that have not been there before hold nothing of the residual.
  check(VecSet(right_, 0.0));
  Mat own = nullptr;
  check(MatGetDiagonalBlock(matrix, &own));
  make_local_solver(own, changed);
  PC shell;
  check(PCCreate(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), &shell));
  check(PCSetType(shell, PCSHELL));
  check(PCShellSetContext(shell, this));
  check(PCShellSetApply(shell, apply));
  check(PCShellSetName(shell, "carried over from a mesh that has been repaired"));
  check(KSPSetPC(solver, shell));
  check(PCDestroy(&shell));
}

CarriedPreconditioner::~CarriedPreconditioner() {
  PetscBool finalized = PETSC_FALSE;
  PetscFinalized(&finalized);
  if (finalized) return;
  PCDestroy(&earlier_);
  VecDestroy(&right_);
  VecDestroy(&solution_);
  KSPDestroy(&local_);
  VecDestroy(&local_right_);
  VecDestroy(&local_solution_);
}

// Cholesky's factor of the rows that changed; the changes lie apart, so that there is little fill.
void CarriedPreconditioner::make_local_solver(Mat own, const std::vector<PetscInt>& changed) {
  PetscInt count = 0;
  const PetscInt* columns = nullptr;
  const PetscScalar* values = nullptr;
  for (const PetscInt row : changed) {
    check(MatGetRow(own, row, &count, &columns, nullptr));
    changed_.insert(changed_.end(), columns, columns + count);
    check(MatRestoreRow(own, row, &count, &columns, nullptr));
  }
  std::sort(changed_.begin(), changed_.end());
  changed_.erase(std::unique(changed_.begin(), changed_.end()), changed_.end());
  if (changed_.empty()) return;
  start_.push_back(0);
  for (const PetscInt row : changed_) {
    check(MatGetRow(own, row, &count, &columns, &values));
    column_.insert(column_.end(), columns, columns + count);
    value_.insert(value_.end(), values, values + count);
    start_.push_back(static_cast<PetscInt>(column_.size()));
    check(MatRestoreRow(own, row, &count, &columns, &values));
  }
  remaining_.resize(row_before_.size());
  correction_.resize(changed_.size());
  MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(own));
  IS rows = nullptr;
  Mat part = nullptr;
  check(ISCreateGeneral(comm, static_cast<PetscInt>(changed_.size()), changed_.data(), PETSC_USE_POINTER, &rows));
  check(MatCreateSubMatrix(own, rows, rows, MAT_INITIAL_MATRIX, &part));
  check(ISDestroy(&rows));
  check(MatSetOption(part, MAT_SPD, PETSC_TRUE));
  check(MatCreateVecs(part, &local_solution_, &local_right_));
  check(KSPCreate(comm, &local_));
  check(KSPSetOperators(local_, part, part));
  check(KSPSetType(local_, KSPPREONLY));
  PC factor = nullptr;
  check(KSPGetPC(local_, &factor));
  check(PCSetType(factor, PCCHOLESKY));
  check(KSPSetUp(local_));
  check(MatDestroy(&part));
}

// correction_ = what solves the rows that changed for their right side, with zero elsewhere.
void CarriedPreconditioner::solve_locally(const PetscScalar* right) {
  PetscScalar* local = nullptr;
  check(VecGetArrayWrite(local_right_, &local));
  for (std::size_t k = 0; k < changed_.size(); ++k) local[k] = right[changed_[k]];
  check(VecRestoreArrayWrite(local_right_, &local));
  check(KSPSolve(local_, local_right_, local_solution_));
  const PetscScalar* found = nullptr;
  check(VecGetArrayRead(local_solution_, &found));
  std::copy_n(found, correction_.size(), correction_.begin());
  check(VecRestoreArrayRead(local_solution_, &found));
}

PetscErrorCode CarriedPreconditioner::apply(PC preconditioner, Vec residual, Vec correction) {
  CarriedPreconditioner* self = nullptr;
  PetscFunctionBegin;
  PetscCall(PCShellGetContext(preconditioner, &self));
  const auto& before = self->row_before_;
  const auto& changed = self->changed_;
  const PetscScalar *given = nullptr, *found = nullptr;
  PetscScalar *inner = nullptr, *c = nullptr;
  PetscCall(VecGetArrayRead(residual, &given));
  const PetscScalar* r = given;
  if (!changed.empty()) {
    self->solve_locally(given);
    std::copy_n(given, before.size(), self->remaining_.begin());
    // By symmetry the rows at hand are the columns too.
    for (std::size_t k = 0; k < changed.size(); ++k)
      for (PetscInt e = self->start_[k]; e < self->start_[k + 1]; ++e)
        self->remaining_[self->column_[e]] -= self->value_[e] * self->correction_[k];
    r = self->remaining_.data();
  }
  PetscCall(VecGetArray(self->right_, &inner));
  for (std::size_t k = 0; k < before.size(); ++k)
    if (before[k] >= 0) inner[before[k]] = r[k];
  PetscCall(VecRestoreArray(self->right_, &inner));
  PetscCall(PCApply(self->earlier_, self->right_, self->solution_));
  PetscCall(VecGetArray(correction, &c));
  PetscCall(VecGetArrayRead(self->solution_, &found));
  for (std::size_t k = 0; k < before.size(); ++k) c[k] = before[k] >= 0 ? found[before[k]] : 0.0;
  PetscCall(VecRestoreArrayRead(self->solution_, &found));
  if (!changed.empty()) {
    // The rows that changed are solved exactly for what the others have come to, whatever was found there before.
    for (const PetscInt row : changed) c[row] = 0.0;
    for (std::size_t k = 0; k < changed.size(); ++k) {
      self->remaining_[changed[k]] = given[changed[k]];
      for (PetscInt e = self->start_[k]; e < self->start_[k + 1]; ++e)
        self->remaining_[changed[k]] -= self->value_[e] * c[self->column_[e]];
    }
    self->solve_locally(self->remaining_.data());
    for (std::size_t k = 0; k < changed.size(); ++k) c[changed[k]] = self->correction_[k];
  }
  PetscCall(VecRestoreArray(correction, &c));
  PetscCall(VecRestoreArrayRead(residual, &given));
  PetscFunctionReturn(0);
}

}  // namespace poreslip::flow
