// Options of PETSc: our defaults, what a user gave in their place, and which of those nothing asked for.
#pragma once

#include <string>
#include <vector>

namespace poreslip::flow {

// Starts PETSc if nobody has; its errors are returned, not printed.
void start_petsc();

// From now on the linear solver's options are these, and the tuned multigrid's where they leave it open; those of the call before are gone.
// PETSc has one table of options for all solvers of a process.
void use_options(const std::string& given);

// Names, without their dash, of the options in `given` that begin with the linear solver's prefix, or would have to, and that no part of
// PETSc has looked at so far.
std::vector<std::string> unused_options(const std::string& given);

// Names, without their dash, of the options that the linear solver with its preconditioner takes.
std::vector<std::string> known_options();

}  // namespace poreslip::flow
