// Which grain of the mesh is which grain of the caller: the caller's order may change, and grains may move to other ranks.
#pragma once

#include <mpi.h>

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "network/grain_input.hpp"
#include "tessellation/halo.hpp"

namespace poreslip {

// The mesh stays with the rank that built it. Grains that have since moved to another rank (strays) are sent from there to the mesh's
// rank, and their forces back; they are few, or the mesh is rebuilt.
class GrainDirectory {
 public:
  // Own grains of the mesh are the caller's, in the caller's order.
  void reset(const std::vector<std::int64_t>& id);

  enum class Match {
    same,       // the mesh can go on
    scattered,  // the same grains, but too many of them are strays
    other,      // grains have come or gone
  };
  // Collective. Takes up the caller's present order. The same answer on all ranks.
  Match match(MPI_Comm comm, const GrainInput& input);

  // Collective. The caller's positions, radii and groups, in the order of the mesh's own grains.
  void gather(MPI_Comm comm, const GrainInput& input, OwnGrains& own) const;

  // Collective. Vectors (n, 3) of the caller's grains, in the order of the mesh's own grains.
  void gather_vectors(MPI_Comm comm, const double* vector, std::vector<std::array<double, 3>>& own) const;

  // Collective. Forces on the mesh's own grains, in the order of the caller's last input. Out: (n, 3).
  void scatter(MPI_Comm comm, const std::vector<std::array<double, 3>>& own, double* force) const;

  std::size_t input_size() const { return own_of_input_.size(); }
  // The mesh's own grain that is the caller's grain i, or -1 if its mesh is on another rank.
  std::int32_t own_of_input(std::size_t i) const { return own_of_input_[i]; }

 private:
  bool route(MPI_Comm comm);

  std::vector<std::pair<std::int64_t, std::int32_t>> by_id_;  // id, own index
  std::vector<std::int64_t> own_id_;                          // of the mesh's own grains
  std::vector<std::int64_t> input_id_;                        // the caller's last ids
  std::vector<std::int32_t> own_of_input_;
  bool any_strays_ = false;  // on any rank
  // The caller's grains whose mesh is on another rank, and own grains that another rank now hands over: by that rank, then by id.
  std::vector<std::int32_t> away_, lost_;
  std::vector<int> away_count_, lost_count_;
};

}  // namespace poreslip
