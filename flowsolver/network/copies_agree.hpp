// Whether the ranks, and the periodic images, that see the same cells have flipped them alike.
#pragma once

#include <mpi.h>

#include "tessellation/domain.hpp"
#include "tessellation/flips.hpp"
#include "tessellation/halo.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

// Collective. found: whether this rank found flips at all. True on all ranks if all did, and each two that share grains have changed the
// same cells. The meshes were one triangulation before; with every facet regular on the rank that has a grain of it, they then are one again.
bool copies_agree(MPI_Comm comm, bool found, const Flips& flips, const Mesh& mesh, const LocalGrains& grains, const Halo& halo);

}  // namespace poreslip
