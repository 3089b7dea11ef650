// The linear solver: PETSc's conjugate gradients with a preconditioner that is kept while it serves.
#pragma once

#include <petscksp.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "flow/carried_preconditioner.hpp"
#include "flow/matrices.hpp"

namespace poreslip::flow {

// What a system is, and what it shares with the one before.
struct SystemShape {
  bool singular;          // only differences of the unknowns are determined
  bool same_structure;
  bool new_values;        // of the entries
};

struct LinearReport {
  int iterations = 0;
  KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
  double residual = 0.0;            // norm at the end
  bool preconditioner_kept = false;
  double setup = 0.0, solve = 0.0;  // seconds of this rank
};

class LinearSolver {
 public:
  // options: as on a PETSc command line, prefix -flow_.
  LinearSolver(MPI_Comm comm, const std::string& options);
  ~LinearSolver();
  LinearSolver(const LinearSolver&) = delete;
  LinearSolver& operator=(const LinearSolver&) = delete;

  // Collective. Begins a system of so many rows on this rank and in all, whose entries are to be written before it is taken up.
  void begin(PetscInt rows, PetscInt all_rows);
  // Their places stay as they are once they have been taken up; their values may change before `take`.
  Entries& entries() { return *entries_; }
  // (rows), to be written before `take`, which ends it.
  PetscScalar* right();

  // Collective. Takes up the entries and the right side. row_before: for each of this rank's rows, its row when the
  // preconditioner was last set up (counted on this rank) or -1; empty if nothing relates the two.
  void take(const SystemShape& shape, const std::vector<PetscInt>& row_before);

  // Collective. start writes the unknowns (rows of this rank) that the iteration begins with; least_residual: norm that counts as zero.
  LinearReport solve(double relative_tolerance, double least_residual, const std::function<void(PetscScalar*)>& start);

  // What reads the right side and the solution (rows of this rank).
  void read(const std::function<void(const PetscScalar* right, const PetscScalar* solution)>& reader) const;

  // Collective. Largest entry of the last residual, and its row.
  std::pair<PetscReal, PetscInt> worst_row() const;

  // The next solve sets its preconditioner up anew.
  void forget_preconditioner() { stale_ = true; }

 private:
  void relate(const std::vector<PetscInt>& row_before);
  void make_solver();
  void free_system();

  MPI_Comm comm_;
  std::string options_;
  PetscInt all_rows_ = 0;
  std::shared_ptr<Entries> entries_;
  Matrices matrices_;
  KSP solver_ = nullptr;
  Vec right_ = nullptr, solution_ = nullptr;
  PetscScalar* right_values_ = nullptr;   // while it is written, or null without rows
  bool right_taken_ = false;
  PetscInt most_iterations_ = 0;          // the user's, or PETSc's
  PC multigrid_ = nullptr;                // the preconditioner last set up for a system of its own,
  Vec multigrid_like_ = nullptr;          // a vector of that system,
  std::shared_ptr<const Entries> multigrid_entries_;  // and its entries
  std::unique_ptr<CarriedPreconditioner> carried_;
  int iterations_at_setup_ = 0;
  bool stale_ = true;
};

}  // namespace poreslip::flow
