#include "tessellation/triangulation.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_3.h>
#include <CGAL/Regular_triangulation_cell_base_3.h>
#include <CGAL/Regular_triangulation_vertex_base_3.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace poreslip {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

// A grain that lies inside others stays without a cell, whatever is inserted after it: there is no need to know where it is.
struct NoHiddenPoints {
  using iterator = Kernel::Weighted_point_3*;
  using const_iterator = const Kernel::Weighted_point_3*;
  iterator begin() { return nullptr; }
  iterator end() { return nullptr; }
  const_iterator begin() const { return nullptr; }
  const_iterator end() const { return nullptr; }
};

using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<Vertex, Kernel, CGAL::Regular_triangulation_vertex_base_3<Kernel>>;
using RegularCellBase = CGAL::Regular_triangulation_cell_base_3<Kernel, CGAL::Triangulation_cell_base_3<Kernel>,
                                                               CGAL::Discard_hidden_points, NoHiddenPoints>;
using CellBase = CGAL::Triangulation_cell_base_with_info_3<std::int32_t, Kernel, RegularCellBase>;
using Structure = CGAL::Triangulation_data_structure_3<VertexBase, CellBase>;
using Regular = CGAL::Regular_triangulation_3<Kernel, Structure>;
using WeightedPoint = Regular::Weighted_point;

WeightedPoint point_of(const LocalGrains& grains, const WallSpheres& walls, Vertex v) {
  if (is_wall(v)) {
    const auto& c = walls.centre[wall_of(v)];
    return {Kernel::Point_3(c[0], c[1], c[2]), walls.radius * walls.radius};
  }
  return {Kernel::Point_3(grains.x[v], grains.y[v], grains.z[v]), grains.radius[v] * grains.radius[v]};
}

// Centre relative to the first vertex (a grain) and squared radius of a cell's orthosphere.
template <class Real>
struct Orthosphere {
  Real centre[3];
  Real square;
  bool well_conditioned;
};

// Walls as planes, their exact limit, or as the spheres that the triangulation knows: what is degenerate between planes, such as three
// grains in a plane across a wall which holds their circle's centre, has an orthosphere between those.
enum class WallShape { plane, sphere };

template <class Real>
Orthosphere<Real> orthosphere(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell, WallShape shape) {
  const Vertex a = cell[0];
  const Real ra = grains.radius[a];
  const double* coordinate[3] = {grains.x.data(), grains.y.data(), grains.z.data()};
  Real row[3][3], right[3], scale = 1;
  for (int k = 0; k < 3; ++k) {
    const Vertex b = cell[k + 1];
    Real square = 0;
    if (is_wall(b) && shape == WallShape::sphere) {
      const Real radius = walls.radius;
      Real distance = 0;
      for (int d = 0; d < 3; ++d) {
        const Real step = Real(walls.centre[wall_of(b)][d]) - Real(coordinate[d][a]);
        row[k][d] = step / radius;
        distance += step * step;
      }
      right[k] = (distance - radius * radius + ra * ra) / (2 * radius);
      square = 1;
    } else if (is_wall(b)) {
      const int axis = wall_axis(wall_of(b));
      for (int d = 0; d < 3; ++d) row[k][d] = 0;
      row[k][axis] = 1;
      right[k] = Real(walls.plane[wall_of(b)]) - Real(coordinate[axis][a]);
      square = 1;
    } else {
      for (int d = 0; d < 3; ++d) {
        row[k][d] = Real(coordinate[d][b]) - Real(coordinate[d][a]);
        square += row[k][d] * row[k][d];
      }
      const Real rb = grains.radius[b];
      right[k] = (square - (rb - ra) * (rb + ra)) / 2;
    }
    scale *= square;
  }
  Real minor[3][3];
  for (int i = 0; i < 3; ++i) {
    const Real *p = row[(i + 1) % 3], *q = row[(i + 2) % 3];
    for (int d = 0; d < 3; ++d) minor[i][d] = p[(d + 1) % 3] * q[(d + 2) % 3] - p[(d + 2) % 3] * q[(d + 1) % 3];
  }
  const Real det = row[0][0] * minor[0][0] + row[0][1] * minor[0][1] + row[0][2] * minor[0][2];
  Orthosphere<Real> o;
  o.well_conditioned = det * det > Real(1e-12) * scale;
  o.square = -ra * ra;
  for (int d = 0; d < 3; ++d) {
    o.centre[d] = (right[0] * minor[0][d] + right[1] * minor[1][d] + right[2] * minor[2][d]) / det;
    o.square += o.centre[d] * o.centre[d];
  }
  return o;
}

// Whether every grain that could lie inside the cell's orthosphere is known.
template <class Real>
bool within(const Orthosphere<Real>& o, const std::array<double, 3>& origin, const std::array<double, 3>& lower,
            const std::array<double, 3>& upper, double largest_radius) {
  const double square = static_cast<double>(o.square) + largest_radius * largest_radius;
  const double reach = std::sqrt(std::max(square, 0.0));
  for (int d = 0; d < 3; ++d) {
    const double centre = origin[d] + static_cast<double>(o.centre[d]);
    // Written so that a centre that is not a number fails.
    if (!(centre - reach >= lower[d] && centre + reach <= upper[d])) return false;
  }
  return true;
}

bool bounded(const std::array<double, 3>& lower, const std::array<double, 3>& upper) {
  for (int d = 0; d < 3; ++d)
    if (std::isfinite(lower[d]) || std::isfinite(upper[d])) return true;
  return false;
}

// Whether no grain that is not known could change the cell.
bool is_final(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell,
              const std::array<double, 3>& lower, const std::array<double, 3>& upper, double largest_radius) {
  const std::array<double, 3> origin{grains.x[cell[0]], grains.y[cell[0]], grains.z[cell[0]]};
  const auto o = orthosphere<double>(grains, walls, cell, WallShape::plane);
  return o.well_conditioned
             ? within(o, origin, lower, upper, largest_radius)
             : within(orthosphere<__float128>(grains, walls, cell, WallShape::sphere), origin, lower, upper, largest_radius);
}

// Grains are inserted along their curve, but first every 512th of them, then every 64th, and so on: next to where all grains are known on one
// side and none on the other, cells are long and slender, and those would be made and undone again all the way.
constexpr std::size_t first_stride = 512, denser = 8;

// The vertex at infinity, beyond the wall spheres.
constexpr Vertex infinitely_far = std::numeric_limits<Vertex>::min();

// Whether a cell that has walls is one of a box: neither infinite nor between opposite walls.
bool box_shaped(const std::array<Vertex, 4>& v) {
  int walls_on_axis[3] = {0, 0, 0};
  for (const Vertex w : v) {
    if (w == infinitely_far || (is_wall(w) && ++walls_on_axis[wall_axis(wall_of(w))] > 1)) return false;
  }
  return true;
}

// Grains first, then walls, still positively oriented.
std::array<Vertex, 4> grains_first(const std::array<Vertex, 4>& v) {
  std::array<int, 4> order;
  int n = 0;
  for (int k = 0; k < 4; ++k)
    if (!is_wall(v[k])) order[n++] = k;
  for (int k = 0; k < 4; ++k)
    if (is_wall(v[k])) order[n++] = k;
  int inversions = 0;
  for (int p = 0; p < 4; ++p)
    for (int q = p + 1; q < 4; ++q) inversions += order[p] > order[q];
  if (inversions % 2 == 1) {
    // A cell of one grain has three walls to exchange; any other has two grains.
    if (is_wall(v[order[1]])) std::swap(order[2], order[3]);
    else std::swap(order[0], order[1]);
  }
  return {v[order[0]], v[order[1]], v[order[2]], v[order[3]]};
}

}  // namespace

LocalCells triangulate(const LocalGrains& grains, const WallSpheres& walls, const std::array<double, 3>& known_lower,
                          const std::array<double, 3>& known_upper, double largest_radius) {
  LocalCells result;
  Regular triangulation;
  for (int w = 0; w < 6; ++w)
    if (walls.present[w]) triangulation.insert(point_of(grains, walls, vertex_of_wall(w)))->info() = vertex_of_wall(w);

  Regular::Cell_handle hint;
  for (std::size_t stride = first_stride; stride > 0; stride /= denser)
    for (std::size_t i = 0; i < grains.size(); i += stride) {
      if (stride < first_stride && i % (stride * denser) == 0) continue;
      const WeightedPoint p = point_of(grains, walls, static_cast<Vertex>(i));
      Regular::Locate_type type;
      int li = 0, lj = 0;
      const auto cell = triangulation.locate(p, type, li, lj, hint);
      if (type == Regular::VERTEX) {
        char text[160];
        std::snprintf(text, sizeof text, "grains %lld and %lld have the same centre; remove one of them",
                      static_cast<long long>(grains.id[cell->vertex(li)->info()]), static_cast<long long>(grains.id[i]));
        result.coincident = text;
        return result;
      }
      const auto vertex = triangulation.insert(p, type, cell, li, lj);
      if (vertex == Regular::Vertex_handle()) continue;
      vertex->info() = static_cast<Vertex>(i);
      hint = vertex->cell();
    }
  if (triangulation.dimension() < 3) {
    result.complete = false;
    return result;
  }

  // Number the cells that touch own grains, and check that they are final.
  triangulation.infinite_vertex()->info() = infinitely_far;
  const bool all_own = std::all_of(grains.source.begin(), grains.source.end(), [](std::int32_t s) { return s >= 0; });
  const bool check = bounded(known_lower, known_upper);
  std::vector<bool> seen(grains.size(), false);
  std::vector<Regular::Cell_handle> cells, others;
  cells.reserve(triangulation.tds().number_of_cells());
  result.vertex.reserve(cells.capacity());
  const auto vertices_of = [](Regular::Cell_handle c) {
    return std::array<Vertex, 4>{c->vertex(0)->info(), c->vertex(1)->info(), c->vertex(2)->info(), c->vertex(3)->info()};
  };
  const auto take = [&](Regular::Cell_handle c, const std::array<Vertex, 4>& v) {
    c->info() = static_cast<std::int32_t>(cells.size());
    cells.push_back(c);
    result.vertex.push_back(v);
  };
  for (auto c = triangulation.tds().cells_begin(); c != triangulation.tds().cells_end(); ++c) {
    const std::array<Vertex, 4> v = vertices_of(c);
    c->info() = -1;
    bool touches = false, walled = false;
    for (const Vertex g : v) {
      touches = touches || (!is_wall(g) && (all_own || grains.own(g)));
      walled = walled || is_wall(g);
    }
    if (!touches) {
      others.push_back(c);
      continue;
    }
    if (walled && !box_shaped(v)) {
      result.complete = false;
      return result;
    }
    const std::array<Vertex, 4> sorted = walled ? grains_first(v) : v;
    if (check && !is_final(grains, walls, sorted, known_lower, known_upper, largest_radius)) {
      result.complete = false;
      return result;
    }
    take(c, sorted);
    for (const Vertex g : sorted)
      if (!is_wall(g)) seen[g] = true;
  }
  result.touching = cells.size();
  if (!all_own)
    for (const Regular::Cell_handle c : others) {
      const std::array<Vertex, 4> v = vertices_of(c);
      const bool near = std::any_of(v.begin(), v.end(), [&seen](Vertex g) { return !is_wall(g) && seen[g]; });
      if (near && box_shaped(v)) take(c, grains_first(v));
    }
  result.neighbour.resize(cells.size());
  constexpr std::size_t ahead = 16;  // cells whose neighbours are asked of memory before they are needed
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const std::array<Vertex, 4>& v = result.vertex[c];
    // Where there are walls, the sorted vertex k is CGAL's vertex of the same name; else nothing was sorted.
    const bool walled = is_wall(v[3]);
    if (c + ahead < cells.size())
      for (int k = 0; k < 4; ++k) __builtin_prefetch(&cells[c + ahead]->neighbor(k)->info());
    for (int k = 0; k < 4; ++k) {
      int place = k;
      while (walled && cells[c]->vertex(place)->info() != v[k]) place = (place + 1) % 4;
      result.neighbour[c][k] = cells[c]->neighbor(place)->info();
    }
  }
  for (std::size_t i = 0; i < grains.size(); ++i) result.hidden += grains.own(i) && !seen[i];
  return result;
}

int exact_orientation(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell) {
  WeightedPoint p[4];
  for (int k = 0; k < 4; ++k) p[k] = point_of(grains, walls, cell[k]);
  return CGAL::orientation(p[0].point(), p[1].point(), p[2].point(), p[3].point());
}

int exact_power_side(const LocalGrains& grains, const WallSpheres& walls, const std::array<Vertex, 4>& cell, Vertex e) {
  WeightedPoint p[4];
  for (int k = 0; k < 4; ++k) p[k] = point_of(grains, walls, cell[k]);
  return Kernel().power_side_of_oriented_power_sphere_3_object()(p[0], p[1], p[2], p[3], point_of(grains, walls, e));
}

}  // namespace poreslip
