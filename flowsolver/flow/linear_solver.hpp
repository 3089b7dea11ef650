// The linear solver: PETSc's conjugate gradients with a preconditioner that is kept while it serves.
#pragma once

#include <petscksp.h>

#include <memory>
#include <string>
#include <vector>

#include "flow/carried_preconditioner.hpp"
#include "flow/rows.hpp"

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

  // Collective. Begins a system with these entries, whose values are to be set before it is taken up.
  void make(Entries&& entries, PetscInt all_rows);
  // Their places stay as they are.
  Entries& entries() { return *entries_; }

  // Collective. Takes up the entries' values and the right side (rows). row_before: for each of this rank's rows, its row when the
  // preconditioner was last set up (counted on this rank) or -1; empty if nothing relates the two.
  void take(const std::vector<double>& right, const SystemShape& shape, const std::vector<PetscInt>& row_before);

  // Collective. unknown (rows of this rank): the start, and the solution. least_residual: norm that counts as zero.
  LinearReport solve(double relative_tolerance, double least_residual, std::vector<double>& unknown);

  // Collective. Sum of the last residual's entries.
  double residual_sum() const;

  // Collective. Largest entry of the last residual, and its row.
  std::pair<PetscReal, PetscInt> worst_row() const;

  // The next solve sets its preconditioner up anew.
  void forget_preconditioner() { stale_ = true; }

 private:
  void relate(const std::vector<PetscInt>& row_before);
  void free_system();

  MPI_Comm comm_;
  std::string options_;
  Mat matrix_ = nullptr;
  Entries* entries_ = nullptr;            // what the matrix is made of, which it owns
  KSP solver_ = nullptr;
  Vec right_ = nullptr, solution_ = nullptr;
  std::vector<double> diagonal_;          // of this rank's rows
  PetscInt most_iterations_ = 0;          // the user's, or PETSc's
  PC multigrid_ = nullptr;                // the preconditioner last set up for a system of its own,
  Vec multigrid_like_ = nullptr;          // and a vector of that system
  std::vector<double> multigrid_diagonal_;  // of that system, this rank's rows
  std::unique_ptr<CarriedPreconditioner> carried_;
  int iterations_at_setup_ = 0;
  bool stale_ = true;
};

}  // namespace poreslip::flow
