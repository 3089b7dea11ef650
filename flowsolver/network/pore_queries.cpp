// What is asked of a pore network's present mesh: places, volumes, sections, ids and counts.
#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/cells.hpp"
#include "geometry/containment.hpp"
#include "network/pore_network.hpp"
#include "network/timer.hpp"

namespace poreslip {
namespace {

constexpr double same_place = 1e-12;  // of a period

}  // namespace

void PoreNetwork::unwrapped_centre(double* centre) {
  const Timer timer(report_.geometry);
  geometry::cell_centroids(mesh_.cell_view(), view(), centre);
}

void PoreNetwork::pore_centre(double* centre) {
  unwrapped_centre(centre);
  for (int d = 0; d < 3; ++d) {
    if (!domain_.periodic[d]) continue;
    for (std::size_t c = 0; c < pores(); ++c) {
      double& x = centre[3 * c + d];
      x -= period_[d] * std::floor((x - domain_.lower[d]) / period_[d]);
    }
  }
}

void PoreNetwork::depth(const Vector3& point, double* depth) const {
  const GrainView grains = view();
  const CellView cells = mesh_.cell_view();
  for (std::size_t c = 0; c < pores(); ++c) {
    depth[c] = -std::numeric_limits<double>::infinity();
    // Copies of the point that lie between the ends of the cell: along a period these are grains.
    std::array<int, 3> first{0, 0, 0}, last{0, 0, 0};
    for (int d = 0; d < 3; ++d) {
      if (!domain_.periodic[d]) continue;
      double low = std::numeric_limits<double>::infinity(), high = -low;
      for (int k = 0; k < 4; ++k)
        if (const Vertex v = cells.vertex[k][c]; !is_wall(v)) {
          low = std::min(low, grains.position(v)[d]);
          high = std::max(high, grains.position(v)[d]);
        }
      first[d] = static_cast<int>(std::ceil((low - point[d]) / period_[d] - same_place));
      last[d] = static_cast<int>(std::floor((high - point[d]) / period_[d] + same_place));
    }
    for (int i = first[0]; i <= last[0]; ++i)
      for (int j = first[1]; j <= last[1]; ++j)
        for (int k = first[2]; k <= last[2]; ++k) {
          const Vector3 copy{point[0] + i * period_[0], point[1] + j * period_[1], point[2] + k * period_[2]};
          depth[c] = std::max(depth[c], geometry::depth_in_cell(cells, grains, c, copy));
        }
  }
}

void PoreNetwork::cell_volume(double* volume) {
  const Timer timer(report_.geometry);
  geometry::cell_volumes(mesh_.cell_view(), view(), volume);
}

const PoreVolumes& PoreNetwork::volumes() {
  if (volumes_known_) return volumes_;
  const Timer timer(report_.geometry);
  volumes_.cell.resize(pores());
  volumes_.pore.resize(pores());
  geometry::pore_volumes(mesh_.cell_view(), view(), volumes_.cell.data(), volumes_.pore.data());
  volumes_known_ = true;
  return volumes_;
}

void PoreNetwork::grains_of_pore(std::int64_t* id) const {
  for (std::size_t c = 0; c < pores(); ++c)
    for (int k = 0; k < 4; ++k) {
      const Vertex v = mesh_.cell_vertex[k][c];
      id[4 * c + k] = is_wall(v) ? v : local_.id[v];
    }
}

std::vector<std::int32_t> PoreNetwork::pores_at_wall(int wall) const {
  std::vector<std::int32_t> found;
  for (std::size_t c = mesh_.cell_end[0]; c < pores(); ++c)
    for (int k = 0; k < 4; ++k)
      if (mesh_.cell_vertex[k][c] == vertex_of_wall(wall)) found.push_back(static_cast<std::int32_t>(c));
  return found;
}

void PoreNetwork::pores_of_throat(std::int32_t* pore) const {
  for (std::size_t f = 0; f < throats(); ++f) {
    pore[2 * f] = mesh_.facet.left[f];
    pore[2 * f + 1] = mesh_.facet.right[f];
  }
}

void PoreNetwork::grains_of_throat(std::int64_t* id) const {
  for (std::size_t f = 0; f < throats(); ++f)
    for (int k = 0; k < 3; ++k) {
      const Vertex v = mesh_.facet.vertex[k][f];
      id[3 * f + k] = is_wall(v) ? v : local_.id[v];
    }
}

void PoreNetwork::owned_throats(bool* owned) const {
  if (halo_.grains().empty()) {
    std::fill_n(owned, throats(), true);
    return;
  }
  for (std::size_t f = 0; f < throats(); ++f) {
    const Vertex v[3] = {mesh_.facet.vertex[0][f], mesh_.facet.vertex[1][f], mesh_.facet.vertex[2][f]};
    owned[f] = belongs_here(v, 3, local_);
  }
}

void PoreNetwork::for_each_throat_block(const std::function<void(const geometry::ThroatBlock&)>& visit) {
  const Timer timer(report_.geometry);
  geometry::for_each_throat_block(mesh_.facet_view(), mesh_.cell_view(), view(), visit);
}

ThroatSections PoreNetwork::throat_sections() {
  ThroatSections s(throats());
  for_each_throat_block([&](const geometry::ThroatBlock& block) {
    std::copy_n(block.facet_area, block.count, &s.facet_area[block.first]);
    std::copy_n(block.open_area, block.count, &s.open_area[block.first]);
    std::copy_n(block.perimeter, block.count, &s.perimeter[block.first]);
    std::copy_n(block.length, block.count, &s.length[block.first]);
  });
  return s;
}

Limited PoreNetwork::limited(double least_open_share, double least_void_share) {
  const PoreVolumes& volume = volumes();
  const auto owned_throat = std::make_unique<bool[]>(throats());
  owned_throats(owned_throat.get());
  std::array<std::int64_t, 2> count{0, 0};
  for (std::size_t c = 0; c < pores(); ++c) count[0] += mesh_.owned[c] && volume.pore[c] < least_void_share * volume.cell[c];
  for_each_throat_block([&](const geometry::ThroatBlock& block) {
    const bool* const owned = &owned_throat[block.first];
    const double *const open = block.open_area, *const facet = block.facet_area;
    std::int64_t below = 0;
    for (std::size_t k = 0; k < block.count; ++k) below += owned[k] & (open[k] < least_open_share * facet[k]);
    count[1] += below;
  });
  MPI_Allreduce(MPI_IN_PLACE, count.data(), 2, MPI_INT64_T, MPI_SUM, comm_);
  return {count[0], count[1]};
}

NetworkReport PoreNetwork::report() const {
  NetworkReport r = report_;
  std::array<std::int64_t, 3> count{static_cast<std::int64_t>(own_.size()), 0, 0};
  if (halo_.grains().empty()) {
    count[1] = static_cast<std::int64_t>(mesh_.cells());
    count[2] = static_cast<std::int64_t>(mesh_.facets());
  } else {
    const auto owned_throat = std::make_unique<bool[]>(mesh_.facets());
    owned_throats(owned_throat.get());
    count[1] = std::count(owned(), owned() + mesh_.cells(), true);
    count[2] = std::count(owned_throat.get(), owned_throat.get() + mesh_.facets(), true);
  }
  MPI_Allreduce(MPI_IN_PLACE, count.data(), 3, MPI_INT64_T, MPI_SUM, comm_);
  r.grains = count[0];
  r.pores = count[1];
  r.throats = count[2];
  r.hidden_grains = hidden_;
  r.halo = halo_width_;
  return r;
}

}  // namespace poreslip
