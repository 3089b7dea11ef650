// Time spent in a scope.
#pragma once

#include <mpi.h>

namespace poreslip {

// Adds the time of its scope, in seconds.
class Timer {
 public:
  explicit Timer(double& total) : total_(total), start_(MPI_Wtime()) {}
  ~Timer() { total_ += MPI_Wtime() - start_; }

 private:
  double& total_;
  double start_;
};

}  // namespace poreslip
