// By how much the volumes of a network's pores change with the places of grains and walls, and the forces that follow from that.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "geometry/cell_response.hpp"
#include "geometry/facets.hpp"
#include "geometry/response_matrix.hpp"
#include "network/pore_network.hpp"

namespace poreslip {

// Bodies are the local grains, one that stays at rest, and behind it the entries (groups, 6) of walls: a wall's displacement along its
// normal, outward, is the first component of its body's.
class VolumeGradients {
 public:
  explicit VolumeGradients(const PoreNetwork& network) : network_(network) {}
  // Where its vectors are filled: only there are they known to be aligned more than others, which freeing must know as well.
  ~VolumeGradients();
  VolumeGradients(const VolumeGradients&) = delete;
  VolumeGradients& operator=(const VolumeGradients&) = delete;

  // Those of the network's present state, with the forces of this law. Whether pores and bodies are connected as they were before.
  bool take(geometry::ForceLaw law);

  const geometry::CellGradients& cells() const { return cells_; }
  const std::vector<geometry::Roof>& roofs() const { return roof_; }  // by cells, ascending
  std::int32_t at_rest() const { return static_cast<std::int32_t>(network_.local_grains().size()); }

  // Adds the forces of the pressures (cells), Pa, on the grains to force (bodies), N.
  void add_forces(const std::vector<double>& pressure, std::vector<geometry::Four>& force) const;

  // Volumes (cells), m^3, that cells gain by displacements (bodies), m.
  std::vector<double> gained(const std::vector<geometry::Four>& displacement) const;

 private:
  using Gradients = std::vector<std::array<geometry::Four, 4>>;  // of the four vertices of each cell; 0 for walls

  void take_corners(const FacetView& facets);
  bool take_roofs();

  const PoreNetwork& network_;
  geometry::CellGradients cells_;
  std::vector<geometry::TriangleCorners> corner_;
  std::int64_t mesh_number_ = -1;  // of the mesh whose corners these are
  Gradients push_;                 // where forces are not the gradients of the volumes (2), else empty
  std::vector<geometry::Roof> roof_;
};

}  // namespace poreslip
