// PETSc's matrices of a rank's entries, made of these arrays as they are.
#pragma once

#include <petscksp.h>

#include <memory>

#include "flow/rows.hpp"

namespace poreslip::flow {

// Both share the entries, which live as long as either does.
struct Matrices {
  Mat system = nullptr;       // of PETSc's own kind
  Mat of_hypre = nullptr;     // for HYPRE's preconditioners, which would make a copy of the other; null where the diagonal does not come first
};

// Collective. From now on the entries' places stay as they are.
Matrices make_matrices(MPI_Comm comm, const std::shared_ptr<Entries>& entries, PetscInt all_rows);

// Collective. Tells PETSc that the entries' values are other ones.
void announce(const Matrices& matrices);

void destroy(Matrices& matrices);

}  // namespace poreslip::flow
