// Copies of other ranks' grains, and of periodic images, around a rank's own grains.
#pragma once

#include <mpi.h>

#include <array>
#include <cstdint>
#include <vector>

#include "tessellation/domain.hpp"

namespace poreslip {

// A rank's own grains as given, in its own order.
struct OwnGrains {
  std::vector<double> x, y, z, radius;  // m
  std::vector<std::int64_t> id;
  std::vector<std::int32_t> group;
  std::size_t size() const { return id.size(); }
};

struct HaloGrain {
  double x, y, z, radius;
  std::int64_t id;
  std::int32_t group;
  std::int32_t rank;   // its owner
  std::int32_t index;  // its place among the owner's own grains
  std::array<std::int8_t, 3> shift;
};

class Halo {
 public:
  // Collective. Fetches every grain, and every periodic image, within width of the bounding box of this rank's own grains.
  // period: the box lengths, exactly as positions are to be shifted.
  void build(MPI_Comm comm, const Domain& domain, const std::array<double, 3>& period, const OwnGrains& own, double width);

  // Collective. Coordinates and radii of the same grains anew.
  void refresh(const OwnGrains& own);

  // Collective. Vectors of the same grains from their owners'.
  std::vector<std::array<double, 3>> fetch(const std::vector<std::array<double, 3>>& own) const;

  // Collective. Vectors of the halo's grains are added to their owners'.
  void add_to_owners(const std::vector<std::array<double, 3>>& halo, std::vector<std::array<double, 3>>& own) const;

  const std::vector<HaloGrain>& grains() const { return grains_; }
  // The region within which every grain is known: unbounded where no grain lies beyond.
  const std::array<double, 3>& known_lower() const { return known_lower_; }
  const std::array<double, 3>& known_upper() const { return known_upper_; }

 private:
  MPI_Comm comm_ = MPI_COMM_NULL;
  std::array<double, 3> period_{};
  std::vector<HaloGrain> grains_;
  std::vector<std::int32_t> send_index_;
  std::vector<std::array<std::int8_t, 3>> send_shift_;
  std::vector<int> send_count_, receive_count_;
  std::array<double, 3> known_lower_{}, known_upper_{};
};

}  // namespace poreslip
