// Whether a mesh is still the regular triangulation of grains that have moved.
#pragma once

#include <cstdint>
#include <vector>

#include "tessellation/domain.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

struct Certificate {
  std::vector<std::size_t> violated_facets;     // facets that fail the power test, surrounding ones last
  std::int64_t violated = 0;                    // how many of them have an own grain
  std::int64_t inverted_cells = 0;              // cells that touch own grains, turned inside out
  std::vector<std::int32_t> inverted_around;    // surrounding cells turned inside out
  std::int64_t exact_tests = 0;                 // tests that double precision could not decide
};

// Every cell positively oriented and every facet locally regular: then, by Delaunay's lemma, the mesh is the triangulation.
// Over all ranks every facet with a grain is tested. A tie passes.
Certificate certify(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls);

}  // namespace poreslip
