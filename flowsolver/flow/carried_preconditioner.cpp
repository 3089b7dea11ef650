#include "flow/carried_preconditioner.hpp"

#include <algorithm>

#include "flow/petsc_check.hpp"

namespace poreslip::flow {

CarriedPreconditioner::CarriedPreconditioner(KSP solver, Mat matrix, PC earlier, Vec earlier_like,
                                             const std::vector<PetscInt>& row_before)
    : earlier_(earlier), row_before_(row_before) {
  check(PetscObjectReference(reinterpret_cast<PetscObject>(earlier_)));
  check(PCSetReusePreconditioner(earlier_, PETSC_TRUE));
  check(VecDuplicate(earlier_like, &right_));
  check(VecDuplicate(earlier_like, &solution_));
  // Rows that have not been there before hold nothing of the residual.
  check(VecSet(right_, 0.0));
  make_local_solver(matrix);
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
void CarriedPreconditioner::make_local_solver(Mat matrix) {
  Mat own = nullptr, part = nullptr;
  check(MatGetDiagonalBlock(matrix, &own));
  std::vector<PetscInt> fresh;
  for (std::size_t k = 0; k < row_before_.size(); ++k)
    if (row_before_[k] < 0) fresh.push_back(static_cast<PetscInt>(k));
  for (const PetscInt row : fresh) {
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    check(MatGetRow(own, row, &count, &columns, nullptr));
    changed_.insert(changed_.end(), columns, columns + count);
    check(MatRestoreRow(own, row, &count, &columns, nullptr));
  }
  std::sort(changed_.begin(), changed_.end());
  changed_.erase(std::unique(changed_.begin(), changed_.end()), changed_.end());
  if (changed_.empty()) return;
  MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(own));
  IS rows = nullptr;
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

PetscErrorCode CarriedPreconditioner::apply(PC preconditioner, Vec residual, Vec correction) {
  CarriedPreconditioner* self = nullptr;
  PetscFunctionBegin;
  PetscCall(PCShellGetContext(preconditioner, &self));
  const auto& before = self->row_before_;
  const PetscScalar* r = nullptr;
  PetscScalar* inner = nullptr;
  PetscCall(VecGetArrayRead(residual, &r));
  PetscCall(VecGetArray(self->right_, &inner));
  for (std::size_t k = 0; k < before.size(); ++k)
    if (before[k] >= 0) inner[before[k]] = r[k];
  PetscCall(VecRestoreArray(self->right_, &inner));
  PetscCall(PCApply(self->earlier_, self->right_, self->solution_));

  PetscScalar* c = nullptr;
  const PetscScalar* found = nullptr;
  PetscCall(VecGetArray(correction, &c));
  PetscCall(VecGetArrayRead(self->solution_, &found));
  for (std::size_t k = 0; k < before.size(); ++k) c[k] = before[k] >= 0 ? found[before[k]] : 0.0;
  PetscCall(VecRestoreArrayRead(self->solution_, &found));
  if (self->local_) {
    PetscScalar* local = nullptr;
    PetscCall(VecGetArray(self->local_right_, &local));
    for (std::size_t k = 0; k < self->changed_.size(); ++k) local[k] = r[self->changed_[k]];
    PetscCall(VecRestoreArray(self->local_right_, &local));
    PetscCall(KSPSolve(self->local_, self->local_right_, self->local_solution_));
    const PetscScalar* part = nullptr;
    PetscCall(VecGetArrayRead(self->local_solution_, &part));
    for (std::size_t k = 0; k < self->changed_.size(); ++k) c[self->changed_[k]] += part[k];
    PetscCall(VecRestoreArrayRead(self->local_solution_, &part));
  }
  PetscCall(VecRestoreArray(correction, &c));
  PetscCall(VecRestoreArrayRead(residual, &r));
  PetscFunctionReturn(0);
}

}  // namespace poreslip::flow
