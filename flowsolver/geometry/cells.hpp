// Volumes, centroids and void volumes of cells, and how a cell's volume answers to its walls: equations (4)-(5).
// A wall is the exact limit of a sphere of infinite radius: a direction in every angle, and a gap. Pure functions.
#pragma once

#include <functional>

#include "geometry/vector3.hpp"
#include "geometry/view.hpp"

namespace poreslip::geometry {

// Volume of each cell, m^3: tetrahedron, prism, wedge (two walls) or corner (three). Out: volume (m).
void cell_volumes(const CellView& cells, const GrainView& grains, double* volume);

// The same of cells with at least so many walls, 1 or 2. Out: volume (m), at their places.
void wall_cell_volumes(const CellView& cells, const GrainView& grains, int walls, double* volume);

// Volume of the void of each cell, m^3, (4)-(5): cell less spherical sectors, plus dihedral angle / 2 pi of each lens that
// two grains, or a grain and a wall, have in common. Out: cell (m), the cells' own volumes, and pore (m).
void pore_volumes(const CellView& cells, const GrainView& grains, double* cell, double* pore);

// Centroid of each cell, m. Out: centre (m, 3).
void cell_centroids(const CellView& cells, const GrainView& grains, double* centre);
Vector3 cell_centroid(const CellView& cells, const GrainView& grains, std::size_t cell);

// Force of the pressures on the walls, N, outward positive: for each cell p * dV/dgap, to the group of the grain whose gap
// it is. counted (m): cells that enter the sum. Adds to force (groups, 6).
void add_wall_forces(const CellView& cells, const GrainView& grains, const bool* counted, const double* pressure,
                     double* force);

// Force on the walls, N, outward positive, of a pressure that in each cell is gradient . (x - its centroid), for a gradient (3), Pa/m,
// along the walls. counted (m): cells that enter the sum; centre (m, 3): their centroids. Adds to force (groups, 6).
void add_wall_forces_of_gradient(const CellView& cells, const GrainView& grains, const bool* counted, const double* centre,
                                 const Vector3& gradient, double* force);

// What moving walls add to the rate of change of the cells' volumes, m^3/s: sum of dV/dgap times the wall's outward speed.
// wall_velocity (groups, 6), m/s, along each wall's outward normal. Adds to rate (m).
void add_wall_volume_rates(const CellView& cells, const GrainView& grains, const double* wall_velocity, double* rate);

// Calls visit(cell, entry, area) for every part of a wall that is a cell's roof, some several times: the cell's volume grows by area,
// m^2, for each metre that the wall moves outward; entry = 6 * group + wall.
void for_each_roof(const CellView& cells, const GrainView& grains, const std::function<void(std::size_t, std::size_t, double)>& visit);

// Gradient of one cell's own volume with respect to the position of its vertex k, m^2.
Vector3 cell_volume_gradient(const CellView& cells, const GrainView& grains, std::size_t cell, int k);

}  // namespace poreslip::geometry
