// Repair of a mesh whose grains have moved a little: Lawson's flips in place of a new triangulation.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tessellation/certificate.hpp"
#include "tessellation/domain.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

// What flips change of a mesh.
struct Flips {
  std::vector<std::int32_t> removed;                   // cells of the mesh, surrounding ones too
  std::vector<std::array<Vertex, 4>> added;            // positively oriented, grains before walls
  // Across the facet opposite vertex k of each: a cell of the mesh (>= 0), an added one (-2 - its index), or -1 where none is known.
  std::vector<std::array<std::int32_t, 4>> neighbour;
};

// The flips that make a mesh the regular triangulation of the grains where they now are, from one whose own cells are all still
// positively oriented. All facets that have an own grain are then regular; surrounding ones as far as their cells are known. Empty
// if the flips get stuck, which only a new triangulation resolves.
std::optional<Flips> flip(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls, const Certificate& certificate);

// Carries them out. The mesh knows of each cell which it was before.
void apply(const Flips& flips, const LocalGrains& grains, Mesh& mesh);

}  // namespace poreslip
