// Which cell holds a point.
#pragma once

#include "geometry/vector3.hpp"
#include "geometry/view.hpp"

namespace poreslip::geometry {

// How deep a point lies in a cell: the least of its coordinates there, each of which is 0 on a facet or roof and 1 at what is opposite;
// at least 0 inside, below 0 outside, minus infinity for a cell without volume.
double depth_in_cell(const CellView& cells, const GrainView& grains, std::size_t cell, const Vector3& point);

}  // namespace poreslip::geometry
