#include "flow/matrices.hpp"

#include <petscmathypre.h>

#include "flow/petsc_check.hpp"

namespace poreslip::flow {
namespace {

static_assert(sizeof(HYPRE_BigInt) == sizeof(PetscInt) && sizeof(HYPRE_Int) == sizeof(PetscInt) && sizeof(HYPRE_Real) == sizeof(PetscScalar),
              "HYPRE and PETSc are built with numbers of the same kinds");

// What HYPRE's matrix stands on.
struct Lent {
  std::shared_ptr<Entries> entries;
  Mat system = nullptr;
  hypre_ParCSRMatrix* matrix = nullptr;
};

PetscErrorCode give_back(void* p) {
  Lent* lent = static_cast<Lent*>(p);
  for (hypre_CSRMatrix* part : {hypre_ParCSRMatrixDiag(lent->matrix), hypre_ParCSRMatrixOffd(lent->matrix)}) {
    // These are freed even where they do not belong to it.
    hypre_CSRMatrixI(part) = nullptr;
    hypre_CSRMatrixJ(part) = nullptr;
    hypre_CSRMatrixData(part) = nullptr;
  }
  hypre_ParCSRMatrixColMapOffd(lent->matrix) = nullptr;
  hypre_ParCSRMatrixDestroy(lent->matrix);
  const PetscErrorCode code = MatDestroy(&lent->system);
  delete lent;
  return code;
}

PetscErrorCode forget(void* p) {
  delete static_cast<std::shared_ptr<Entries>*>(p);
  return 0;
}

// The matrix takes something with it that is freed when it is.
void attach(Mat matrix, void* thing, PetscErrorCode (*free)(void*)) {
  PetscContainer container = nullptr;
  check(PetscContainerCreate(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), &container));
  check(PetscContainerSetPointer(container, thing));
  check(PetscContainerSetUserDestroy(container, free));
  check(PetscObjectCompose(reinterpret_cast<PetscObject>(matrix), "entries", reinterpret_cast<PetscObject>(container)));
  check(PetscContainerDestroy(&container));
}

// Its blocks of own and other columns; the latter is null on one rank.
void blocks(Mat matrix, Mat& own, Mat& other, const PetscInt*& other_columns) {
  PetscBool serial = PETSC_FALSE;
  own = matrix;
  other = nullptr;
  other_columns = nullptr;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(matrix), MATSEQAIJ, &serial));
  if (!serial) check(MatMPIAIJGetSeqAIJ(matrix, &own, &other, &other_columns));
}

void lend(hypre_CSRMatrix* part, PetscInt* start, PetscInt* column, PetscScalar* value) {
  hypre_CSRMatrixI(part) = start;
  hypre_CSRMatrixJ(part) = column;
  hypre_CSRMatrixData(part) = value;
  hypre_CSRMatrixOwnsData(part) = 0;
}

Mat make_of_hypre(MPI_Comm comm, const std::shared_ptr<Entries>& entries, Mat system, PetscInt all_rows) {
  Mat own = nullptr, other = nullptr, matrix = nullptr;
  const PetscInt* other_columns = nullptr;
  PetscInt other_count = 0, first = 0, end = 0;
  blocks(system, own, other, other_columns);
  check(MatGetOwnershipRange(system, &first, &end));
  if (other) check(MatGetSize(other, nullptr, &other_count));
  HYPRE_BigInt range[2] = {first, end};
  Entries& e = *entries;
  hypre_ParCSRMatrix* const lent = hypre_ParCSRMatrixCreate(comm, all_rows, all_rows, range, range, other_count, static_cast<HYPRE_Int>(e.value.size()),
                                                            static_cast<HYPRE_Int>(e.other_value.size()));
  lend(hypre_ParCSRMatrixDiag(lent), e.start.data(), e.column.data(), e.value.data());
  // PETSc has counted the other columns anew, in place.
  lend(hypre_ParCSRMatrixOffd(lent), e.other_start.data(), e.other_column.data(), e.other_value.data());
  hypre_ParCSRMatrixColMapOffd(lent) = const_cast<HYPRE_BigInt*>(other_columns);
  check(PetscObjectReference(reinterpret_cast<PetscObject>(system)));
  check(MatCreateFromParCSR(lent, MATHYPRE, PETSC_USE_POINTER, &matrix));
  attach(matrix, new Lent{entries, system, lent}, give_back);
  return matrix;
}

}  // namespace

Matrices make_matrices(MPI_Comm comm, const std::shared_ptr<Entries>& entries, PetscInt all_rows) {
  Matrices made;
  Entries& e = *entries;
  const auto rows = static_cast<PetscInt>(e.rows());
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  if (ranks == 1)
    check(MatCreateSeqAIJWithArrays(comm, rows, rows, e.start.data(), e.column.data(), e.value.data(), &made.system));
  else
    check(MatCreateMPIAIJWithSplitArrays(comm, rows, rows, all_rows, all_rows, e.start.data(), e.column.data(), e.value.data(), e.other_start.data(),
                                         e.other_column.data(), e.other_value.data(), &made.system));
  attach(made.system, new std::shared_ptr<Entries>(entries), forget);
  if (e.diagonal_first) made.of_hypre = make_of_hypre(comm, entries, made.system, all_rows);
  return made;
}

void announce(const Matrices& matrices) {
  Mat own = nullptr, other = nullptr;
  const PetscInt* other_columns = nullptr;
  blocks(matrices.system, own, other, other_columns);
  for (Mat part : {own, other}) {
    if (!part) continue;
    PetscScalar* value = nullptr;
    check(MatSeqAIJGetArrayWrite(part, &value));
    check(MatSeqAIJRestoreArrayWrite(part, &value));
  }
  check(MatAssemblyBegin(matrices.system, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(matrices.system, MAT_FINAL_ASSEMBLY));
  if (!matrices.of_hypre) return;
  check(MatAssemblyBegin(matrices.of_hypre, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(matrices.of_hypre, MAT_FINAL_ASSEMBLY));
}

void destroy(Matrices& matrices) {
  MatDestroy(&matrices.of_hypre);
  MatDestroy(&matrices.system);
}

}  // namespace poreslip::flow
