// Agreement between ranks: an error found on one rank becomes the same error on all of them.
#pragma once

#include <mpi.h>

#include <string>

namespace poreslip {

// Collective. Throws InputError with the message of the lowest rank that has one (empty: none).
void agree_on_input(MPI_Comm comm, const std::string& message);
// Collective. The same with ComputationError.
void agree_on_computation(MPI_Comm comm, const std::string& message);

// Collective. True on all ranks if true on any.
bool any_rank(MPI_Comm comm, bool value);

}  // namespace poreslip
