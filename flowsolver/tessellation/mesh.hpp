// The mesh of one rank: all cells that touch its own grains, and all facets between them that do, as structures of arrays. Next to a
// halo the cells around these are known too, for flips alone.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "geometry/view.hpp"
#include "tessellation/domain.hpp"
#include "tessellation/triangulation.hpp"

namespace poreslip {

// When made, facets are sorted by kind, then by their left cell; flips keep the kinds apart. Kinds: facets of the mesh by their number of
// walls, 0 to 2, then the surrounding ones, without walls and with. The apex of either cell is its vertex off the facet.
struct FacetArrays {
  std::array<std::vector<Vertex>, 3> vertex;
  std::vector<std::int32_t> left, right;
  std::vector<Vertex> left_apex, right_apex;
  std::array<std::size_t, 5> end{};                    // by kind
  std::size_t size() const { return end[2]; }          // of the mesh
  std::size_t all() const { return end[4]; }           // with the surrounding ones
  FacetView view() const {
    return {{vertex[0].data(), vertex[1].data(), vertex[2].data()}, left.data(), right.data(), left_apex.data(), right_apex.data(),
            {end[0], end[1], end[2]}};
  }
};

struct Mesh {
  // When made, cells are sorted by kind, then by their first grain along the Hilbert curve; flips keep the kinds apart. Kinds: cells
  // that touch an own grain by their number of walls, 0 to 3, then the surrounding ones, without walls and with.
  std::array<std::vector<Vertex>, 4> cell_vertex;
  std::array<std::size_t, 6> cell_end{};                // by kind
  std::array<std::vector<std::int32_t>, 4> cell_facet;  // the facet opposite each vertex, -1 where none is known
  std::unique_ptr<bool[]> owned;                        // (cells): belongs to this rank
  std::vector<std::int32_t> previous;                   // (cells), after a repair: the same cell of the mesh before, -1 for new ones; else empty
  // Facets with an own grain lie between two cells of the mesh; surrounding ones have none, and no right cell (-1) where that is not known.
  FacetArrays facet;
  FacetArrays outer;  // of owned cells, without an own grain: the surrounding ones once more, each for itself and without a right cell (-1)
  std::size_t changed = 0;  // cells by flips since the mesh was sorted

  std::size_t cells() const { return cell_end[3]; }
  std::size_t all_cells() const { return cell_end[5]; }  // with the surrounding ones
  std::size_t facets() const { return facet.size(); }
  bool walled(std::size_t cell) const { return cell >= cell_end[0] && cell < cell_end[3]; }
  std::array<Vertex, 4> vertices(std::size_t cell) const {
    return {cell_vertex[0][cell], cell_vertex[1][cell], cell_vertex[2][cell], cell_vertex[3][cell]};
  }
  std::int32_t neighbour(std::size_t cell, int k) const {
    const std::int32_t f = cell_facet[k][cell];
    if (f < 0) return -1;
    return facet.left[f] == static_cast<std::int32_t>(cell) ? facet.right[f] : facet.left[f];
  }
  CellView cell_view() const {
    return {{cell_vertex[0].data(), cell_vertex[1].data(), cell_vertex[2].data(), cell_vertex[3].data()},
            {cell_end[0], cell_end[1], cell_end[2], cell_end[3]}};
  }
  FacetView facet_view() const { return facet.view(); }
};

Mesh make_mesh(const LocalCells& cells, const LocalGrains& grains);

// The same mesh in the order of a new one.
Mesh sorted(const Mesh& mesh, const LocalGrains& grains);

// Facets of the mesh whose left or right cell has walls.
std::vector<std::size_t> facets_at_walls(const Mesh& mesh);

// The surrounding facets of owned cells, each for itself.
FacetArrays outer_facets(const Mesh& mesh);

// Whether any of the vertices is one of this rank's own grains.
bool touches_own(const Vertex* vertex, int count, const LocalGrains& grains);

// The vertex whose rank a cell or facet with these vertices belongs to: its grain of lowest id (of its periodic images the one
// of lowest shift). The same for all copies.
Vertex leading_vertex(const Vertex* vertex, int count, const LocalGrains& grains);

// Whether the leading vertex is this rank's own grain: true on exactly one rank, for exactly one of the periodic copies.
bool belongs_here(const Vertex* vertex, int count, const LocalGrains& grains);

}  // namespace poreslip
