// Sum of a count over ranks.
#pragma once

#include <mpi.h>

#include <cstdint>

namespace poreslip::flow {

inline std::int64_t sum(MPI_Comm comm, std::int64_t value) {
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_INT64_T, MPI_SUM, comm);
  return value;
}

}  // namespace poreslip::flow
