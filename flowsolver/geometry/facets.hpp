// Facets between cells: how the pressure difference across one is shared among its grains, (2). Pure functions.
#pragma once

#include <array>
#include <cstdint>

#include "geometry/four.hpp"
#include "geometry/vector3.hpp"
#include "geometry/view.hpp"

namespace poreslip::geometry {

enum class ForceLaw {
  pressure,  // (2): the pressure on the grains' own patches; per facet, difference * sector
  total,     // and the throats' viscous drag: the gradient of the pore volumes, F_g = sum_k p_k dV_k/dx_g
};

// Forces of the pressures on the grains, N: F_k += (p_left - p_right) * S_k * n for the grains k of every facet, with S_k the
// grain's sector (pressure) or sector and share of the throat (total; sum_k S_k = the facet's area exactly). The lens of an
// overlap is held frozen: fluid pressure acts all round a grain, so that contact forces are effective ones.
// Adds to force (grains), of which the last component stays free: one grain, one half of a cache line.
void add_facet_forces(const FacetView& facets, const GrainView& grains, const double* pressure, ForceLaw law, Four* force);

// Rates of change of the pores' volumes by the grains' motion, m^3/s, from the coefficients of `total`: what the grains gain in
// work the fluid loses. velocity: (grains) each, m/s. Adds to rate (pores); a right cell of -1 is left out.
void add_volume_rates(const FacetView& facets, const GrainView& grains, const double* vx, const double* vy,
                      const double* vz, double* rate);

// Gradients of the cells' volumes that triangles give them: adds S_k n (total) for the three grains of each triangle to gradient
// (cells, 4, 4), m^2, whose last column stays free, of the left cell, and takes it from the right one's; a right cell of -1 is left out.
// corner (triangles): which vertices of the left and of the right cell the three grains are.
struct TriangleCorners {
  std::array<std::uint8_t, 3> left, right;
};
void add_triangle_gradients(const FacetView& facets, const GrainView& grains, const TriangleCorners* corner, double* gradient);

// Coefficients S_k of one facet, m^2, and its unit normal out of the left cell.
struct FacetShares {
  std::array<double, 3> share;
  Vector3 normal;
};
FacetShares facet_shares(const FacetView& facets, const GrainView& grains, std::size_t facet, ForceLaw law);

// The part of facet f's own area (its solid left out of account) that moves with its vertex k, m^2: the mean of the vertex'
// barycentric coordinate times the area.
std::array<double, 3> facet_area_shares(const FacetView& facets, const GrainView& grains, std::size_t facet);

}  // namespace poreslip::geometry
