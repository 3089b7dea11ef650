// Void over solid surface of a throat's sub-volume: the two pyramids from its facet to the power centres of its cells.
#pragma once

#include <cstddef>

#include "geometry/view.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip::flow {

struct ThroatBody {
  double radius;  // void / solid surface, m
  double length;  // between the power centres, m
  bool limited;   // whether they were moved apart to the least length
};

// Walls are free-slip: their surface does not count.
ThroatBody throat_body(const Mesh& mesh, const GrainView& grains, std::size_t facet);

}  // namespace poreslip::flow
