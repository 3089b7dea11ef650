// Items from each rank to each.
#pragma once

#include <mpi.h>

#include <vector>

namespace poreslip {

// How many items each rank sends to this one.
inline std::vector<int> exchange_counts(MPI_Comm comm, const std::vector<int>& send_count) {
  std::vector<int> receive_count(send_count.size());
  MPI_Alltoall(send_count.data(), 1, MPI_INT, receive_count.data(), 1, MPI_INT, comm);
  return receive_count;
}

// Exchange of count[r] items of a trivially copyable type with each rank r.
template <class Item>
std::vector<Item> exchange(MPI_Comm comm, const std::vector<Item>& sent, const std::vector<int>& send_count,
                           const std::vector<int>& receive_count) {
  const std::size_t ranks = send_count.size();
  std::vector<int> send_bytes(ranks), send_start(ranks), receive_bytes(ranks), receive_start(ranks);
  int sent_total = 0, received_total = 0;
  for (std::size_t r = 0; r < ranks; ++r) {
    send_start[r] = sent_total;
    receive_start[r] = received_total;
    send_bytes[r] = send_count[r];
    receive_bytes[r] = receive_count[r];
    sent_total += send_count[r];
    received_total += receive_count[r];
  }
  MPI_Datatype type;
  MPI_Type_contiguous(sizeof(Item), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  std::vector<Item> received(received_total);
  MPI_Alltoallv(sent.data(), send_bytes.data(), send_start.data(), type, received.data(), receive_bytes.data(),
                receive_start.data(), type, comm);
  MPI_Type_free(&type);
  return received;
}

}  // namespace poreslip
