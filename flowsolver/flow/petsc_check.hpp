// PETSc's return codes become exceptions here, and nowhere else.
#pragma once

#include <HYPRE_utilities.h>
#include <petscsys.h>

#include <string>

#include "tessellation/errors.hpp"

namespace poreslip::flow {

// What PETSc has to say of an error, of the one at hand if it says anything.
inline std::string words_of(PetscErrorCode code) {
  const char* text = nullptr;
  char* said = nullptr;
  PetscErrorMessage(code, &text, &said);
  std::string words = said && *said ? said : text ? text : "";
  while (!words.empty() && (words.back() == '\n' || words.back() == ' ')) words.pop_back();
  return words;
}

inline void check(PetscErrorCode code) {
  if (code == 0) return;
  // HYPRE remembers an error, and would refuse whatever comes after it.
  if (code == PETSC_ERR_LIB) HYPRE_ClearAllErrors();
  throw ComputationError("PETSc error " + std::to_string(code) + ": " + words_of(code));
}

// For what reads the user's options, which all ranks have alike.
inline void check_options(PetscErrorCode code) {
  if (code != 0) throw InputError("an option of PETSc (-flow_...) has a value that it does not take: " + words_of(code));
}

}  // namespace poreslip::flow
