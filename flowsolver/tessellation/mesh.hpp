// The mesh of one rank: all cells that touch its own grains, and all facets between them that do, as structures of arrays.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "geometry/view.hpp"
#include "tessellation/domain.hpp"
#include "tessellation/triangulation.hpp"

namespace poreslip {

struct Mesh {
  // Cells sorted by their number of walls, then by their first grain along the Hilbert curve.
  std::array<std::vector<Vertex>, 4> cell_vertex;
  std::array<std::size_t, 4> cell_end{};
  // Facets likewise. The apex of either cell is its vertex that is not on the facet.
  std::array<std::vector<Vertex>, 3> facet_vertex;
  std::vector<std::int32_t> left, right;
  std::vector<Vertex> left_apex, right_apex;
  std::array<std::size_t, 3> facet_end{};

  std::size_t cells() const { return cell_end[3]; }
  std::size_t facets() const { return facet_end[2]; }
  CellView cell_view() const {
    return {{cell_vertex[0].data(), cell_vertex[1].data(), cell_vertex[2].data(), cell_vertex[3].data()}, cell_end};
  }
  FacetView facet_view() const {
    return {{facet_vertex[0].data(), facet_vertex[1].data(), facet_vertex[2].data()}, left.data(), right.data(), facet_end};
  }
};

Mesh make_mesh(const TouchingCells& cells, const LocalGrains& grains);

// Whether a cell or facet with these vertices belongs to this rank: its grain of lowest id (of its periodic images the one
// of lowest shift) is the rank's own. True on exactly one rank, for exactly one of the periodic copies.
bool belongs_here(const Vertex* vertex, int count, const LocalGrains& grains);

}  // namespace poreslip
