// PETSc's return codes become exceptions here, and nowhere else.
#pragma once

#include <petscsys.h>

#include <string>

#include "tessellation/errors.hpp"

namespace poreslip::flow {

inline void check(PetscErrorCode code) {
  if (code == 0) return;
  const char* text = nullptr;
  PetscErrorMessage(code, &text, nullptr);
  throw ComputationError("PETSc error " + std::to_string(code) + (text ? std::string(": ") + text : ""));
}

}  // namespace poreslip::flow
