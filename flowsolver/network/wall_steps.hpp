// Cells under a step between the planes of two groups of grains.
#pragma once

#include <vector>

#include "geometry/cells.hpp"
#include "geometry/facets.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

// Where neighbouring grains have different planes, the roof of their cell is not square to the wall: the pressure on it has a
// part along the wall. It is what the gradient of the cell's volume has over and above the shares of the cell's facets.
// wall_facets: facets of cells that have walls. Calls visit(cell, grain, part of dV_cell/dx_grain), several times for a pair.
template <class Visit>
void for_each_step_gradient(const Mesh& mesh, const GrainView& grains, const std::vector<std::size_t>& wall_facets,
                            Visit visit) {
  const CellView cells = mesh.cell_view();
  const auto stepped = [&](std::size_t c) {
    for (int k = 1; k < 4; ++k)
      for (int g = 1; g < 4; ++g) {
        const Vertex wall = cells.vertex[k][c], grain = cells.vertex[g][c];
        if (!is_wall(wall) || is_wall(grain)) continue;
        const auto plane = [&](Vertex v) { return grains.wall_position[6 * grains.group[v] + wall_of(wall)]; };
        if (plane(grain) != plane(cells.vertex[0][c])) return true;
      }
    return false;
  };
  std::vector<bool> is_stepped(cells.size() - cells.end[0]);
  bool any = false;
  for (std::size_t c = cells.end[0]; c < cells.end[2]; ++c) {
    if (!stepped(c)) continue;
    any = is_stepped[c - cells.end[0]] = true;
    for (int k = 0; k < 4; ++k)
      if (!is_wall(cells.vertex[k][c])) visit(c, cells.vertex[k][c], geometry::cell_volume_gradient(cells, grains, c, k));
  }
  if (!any) return;
  const auto subtract = [&](const FacetArrays& facets, std::size_t f) {
    for (const auto& [cell, sign] : {std::pair{facets.left[f], 1.0}, std::pair{facets.right[f], -1.0}}) {
      const std::size_t c = static_cast<std::size_t>(cell);
      if (cell < 0 || c < cells.end[0] || !is_stepped[c - cells.end[0]]) continue;
      const Vector3 normal = geometry::facet_shares(facets.view(), grains, f, geometry::ForceLaw::total).normal;
      const auto share = geometry::facet_area_shares(facets.view(), grains, f);
      for (int k = 0; k < 3; ++k)
        if (!is_wall(facets.vertex[k][f])) visit(c, facets.vertex[k][f], (-sign * share[k]) * normal);
    }
  };
  for (const std::size_t f : wall_facets) subtract(mesh.facet, f);
  for (std::size_t f = 0; f < mesh.outer.size(); ++f) subtract(mesh.outer, f);
}

}  // namespace poreslip
