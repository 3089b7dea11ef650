// Values in pores, between the rank that owns a pore and the ranks (or periodic copies) that also see it.
#pragma once

#include <mpi.h>

#include <cstdint>
#include <vector>

#include "tessellation/domain.hpp"
#include "tessellation/halo.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

class PoreExchange {
 public:
  // Collective. Finds the owner of every local pore. Throws ComputationError on all ranks if two ranks see different meshes.
  void build(MPI_Comm comm, const Mesh& mesh, const LocalGrains& grains, const Halo& halo);

  // Collective. Values of the owners go to all copies. value (pores), of double, int32, int64 or uint8.
  template <class Value>
  void fetch(Value* value) const;

  // Collective. Values of the copies are added to their owners'. value (pores).
  void add_to_owner(double* value) const;

  // Of each local pore: the rank that owns it and its index there.
  std::int32_t owner_rank(std::size_t pore) const { return owner_rank_[pore]; }
  std::int32_t owner_index(std::size_t pore) const { return owner_index_[pore]; }

 private:
  MPI_Comm comm_ = MPI_COMM_NULL;
  bool alone_ = true;                       // no copies anywhere
  std::vector<std::int32_t> owner_rank_, owner_index_;
  std::vector<std::int32_t> copy_;          // local pores owned elsewhere, by owner
  std::vector<std::int32_t> source_;        // local pores that others see, by the rank that does
  std::vector<int> copy_count_, copy_start_, source_count_, source_start_;
};

}  // namespace poreslip
