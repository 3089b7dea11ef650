// A preconditioner from before a few pores changed.
#pragma once

#include <petscksp.h>

#include <vector>

namespace poreslip::flow {

// Preconditioner of a system most of whose unknowns are those of an earlier one: the exact solution on the rows that changed and
// around them, then the earlier preconditioner on what was there before, then the first once more (multiplicative Schwarz,
// symmetric). Without the last, throats that have become much more open would leave eigenvalues as large as they are.
class CarriedPreconditioner {
 public:
  // Collective. earlier: set up for a system like the vector earlier_like; row_before: of each of this rank's rows in that
  // system, counted on this rank, or -1. The solver uses it from now on.
  // changed: this rank's rows that are new or much changed.
  CarriedPreconditioner(KSP solver, Mat matrix, PC earlier, Vec earlier_like, const std::vector<PetscInt>& row_before,
                        const std::vector<PetscInt>& changed);
  ~CarriedPreconditioner();
  CarriedPreconditioner(const CarriedPreconditioner&) = delete;
  CarriedPreconditioner& operator=(const CarriedPreconditioner&) = delete;

 private:
  static PetscErrorCode apply(PC preconditioner, Vec residual, Vec correction);
  void make_local_solver(Mat own, const std::vector<PetscInt>& changed);
  void solve_locally(const PetscScalar* right);

  PC earlier_ = nullptr;
  Vec right_ = nullptr, solution_ = nullptr;             // of the earlier system
  std::vector<PetscInt> row_before_;
  std::vector<PetscInt> changed_;                        // rows that changed and their neighbours, on this rank
  std::vector<PetscInt> start_, column_;                 // the matrix' rows at these, columns of this rank only
  std::vector<PetscScalar> value_;
  KSP local_ = nullptr;
  Vec local_right_ = nullptr, local_solution_ = nullptr;
  std::vector<PetscScalar> remaining_, correction_;      // residual of this rank's rows; at the rows that changed
};

}  // namespace poreslip::flow
