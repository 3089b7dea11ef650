// Throats: the open sections of facets, (6), and how far apart their pores are. Pure functions.
#pragma once

#include <functional>

#include "geometry/view.hpp"

namespace poreslip::geometry {

// Throats [first, first + count): arrays (count).
struct ThroatBlock {
  std::size_t first, count;
  const double* facet_area;  // m^2
  const double* open_area;   // m^2, may be negative before any limiter
  const double* perimeter;   // m, of the open area: arcs, open gaps between grains, and the line on a wall
  const double* length;      // m, between the centroids of the two cells
};

// Calls visit for blocks of facets, in their order. All of them have a right cell.
void for_each_throat_block(const FacetView& facets, const CellView& cells, const GrainView& grains,
                           const std::function<void(const ThroatBlock&)>& visit);

// Conductances of a block's throats over their lengths, m^3/(Pa s), by (6): C / l, C = 3 A^3 / (5 viscosity P^2), with A at least least_open_share of
// the facet. The flow is q = C (p_i - p_j) / l. counted (count): the others' are 0. Out: conductance (count). Returns how many areas were raised.
std::size_t duct_conductances(const ThroatBlock& throats, double viscosity, double least_open_share, const bool* counted, double* conductance);

}  // namespace poreslip::geometry
