// A preconditioner from before a few pores changed.
#pragma once

#include <petscksp.h>

#include <vector>

namespace poreslip::flow {

// Preconditioner of a system most of whose unknowns are those of an earlier one: the earlier one's on these, plus the exact
// solution on the new unknowns and their neighbours (additive Schwarz: symmetric, positive definite).
class CarriedPreconditioner {
 public:
  // Collective. earlier: set up for a system like the vector earlier_like; row_before: of each of this rank's rows in that
  // system, counted on this rank, or -1. The solver uses it from now on.
  CarriedPreconditioner(KSP solver, Mat matrix, PC earlier, Vec earlier_like, const std::vector<PetscInt>& row_before);
  ~CarriedPreconditioner();
  CarriedPreconditioner(const CarriedPreconditioner&) = delete;
  CarriedPreconditioner& operator=(const CarriedPreconditioner&) = delete;

 private:
  static PetscErrorCode apply(PC preconditioner, Vec residual, Vec correction);
  void make_local_solver(Mat matrix);

  PC earlier_ = nullptr;
  Vec right_ = nullptr, solution_ = nullptr;             // of the earlier system
  std::vector<PetscInt> row_before_;
  std::vector<PetscInt> changed_;                        // new rows and their neighbours, on this rank
  KSP local_ = nullptr;
  Vec local_right_ = nullptr, local_solution_ = nullptr;
};

}  // namespace poreslip::flow
