// Repair of a mesh whose grains have moved a little: Lawson's flips in place of a new triangulation.
#pragma once

#include <optional>
#include <vector>

#include "tessellation/domain.hpp"
#include "tessellation/mesh.hpp"
#include "tessellation/triangulation.hpp"

namespace poreslip {

// The regular triangulation of the grains where they now are, by flips from a mesh whose cells are all still positively
// oriented. violated: its facets that fail the power test. For a rank that knows the whole pack (no halo). Empty if the flips
// get stuck, which only a new triangulation resolves.
std::optional<TouchingCells> flip(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls,
                                  const std::vector<std::size_t>& violated);

}  // namespace poreslip
