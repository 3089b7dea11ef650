#include "tessellation/agreement.hpp"

#include "tessellation/errors.hpp"

namespace poreslip {
namespace {

// The message of the lowest rank that has one, on all ranks.
std::string first_message(MPI_Comm comm, const std::string& message) {
  int rank = 0, size = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  int first = message.empty() ? size : rank;
  MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, comm);
  if (first == size) return {};
  int length = static_cast<int>(message.size());
  MPI_Bcast(&length, 1, MPI_INT, first, comm);
  std::string common = rank == first ? message : std::string(length, ' ');
  MPI_Bcast(common.data(), length, MPI_CHAR, first, comm);
  return common;
}

}  // namespace

void agree_on_input(MPI_Comm comm, const std::string& message) {
  if (const std::string common = first_message(comm, message); !common.empty()) throw InputError(common);
}

void agree_on_computation(MPI_Comm comm, const std::string& message) {
  if (const std::string common = first_message(comm, message); !common.empty()) throw ComputationError(common);
}

bool any_rank(MPI_Comm comm, bool value) {
  int flag = value ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &flag, 1, MPI_INT, MPI_MAX, comm);
  return flag != 0;
}

}  // namespace poreslip
