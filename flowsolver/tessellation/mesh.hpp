// The mesh of one rank: all cells that touch its own grains, and all facets between them that do, as structures of arrays.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "geometry/view.hpp"
#include "tessellation/domain.hpp"
#include "tessellation/triangulation.hpp"

namespace poreslip {

// Facets sorted by their number of walls, then by their left cell. The apex of either cell is its vertex off the facet.
struct FacetArrays {
  std::array<std::vector<Vertex>, 3> vertex;
  std::vector<std::int32_t> left, right;
  std::vector<Vertex> left_apex, right_apex;
  std::array<std::size_t, 3> end{};
  std::size_t size() const { return end[2]; }
  FacetView view() const { return {{vertex[0].data(), vertex[1].data(), vertex[2].data()}, left.data(), right.data(), end}; }
};

struct Mesh {
  // Cells sorted by their number of walls, then by their first grain along the Hilbert curve.
  std::array<std::vector<Vertex>, 4> cell_vertex;
  std::array<std::size_t, 4> cell_end{};
  std::unique_ptr<bool[]> owned;   // (cells): belongs to this rank
  std::vector<std::int32_t> previous;  // after a repair: the same cell of the mesh before, -1 for new ones; else empty
  FacetArrays facet;               // between two cells, with an own grain
  FacetArrays outer;               // of owned cells, without an own grain: no right cell here (-1)

  std::size_t cells() const { return cell_end[3]; }
  std::size_t facets() const { return facet.size(); }
  CellView cell_view() const {
    return {{cell_vertex[0].data(), cell_vertex[1].data(), cell_vertex[2].data(), cell_vertex[3].data()}, cell_end};
  }
  FacetView facet_view() const { return facet.view(); }
};

Mesh make_mesh(const TouchingCells& cells, const LocalGrains& grains);

// The vertex whose rank a cell or facet with these vertices belongs to: its grain of lowest id (of its periodic images the one
// of lowest shift). The same for all copies.
Vertex leading_vertex(const Vertex* vertex, int count, const LocalGrains& grains);

// Whether the leading vertex is this rank's own grain: true on exactly one rank, for exactly one of the periodic copies.
bool belongs_here(const Vertex* vertex, int count, const LocalGrains& grains);

}  // namespace poreslip
