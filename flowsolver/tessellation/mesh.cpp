#include "tessellation/mesh.hpp"

#include <algorithm>

namespace poreslip {
namespace {

// Vertices of the facet opposite vertex k of a positively oriented cell, turning so that its normal points out of the cell.
constexpr int outward_facet[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

// The same facet with grains before walls; a rotation keeps the normal.
std::array<Vertex, 3> grains_first(std::array<Vertex, 3> f) {
  while (is_wall(f[0]) || (is_wall(f[1]) && !is_wall(f[2]))) f = {f[1], f[2], f[0]};
  return f;
}

int count_walls(const Vertex* v, int count) {
  int walls = 0;
  for (int k = 0; k < count; ++k) walls += is_wall(v[k]);
  return walls;
}

// Order of cells by number of walls, then by lowest grain: a counting sort.
std::vector<std::int32_t> sorted_order(const TouchingCells& cells, std::size_t grains, std::array<std::size_t, 4>& end) {
  const std::size_t n = cells.vertex.size();
  std::vector<std::uint32_t> key(n), start(4 * grains + 1, 0);
  end = {0, 0, 0, 0};
  for (std::size_t c = 0; c < n; ++c) {
    const auto& v = cells.vertex[c];
    const int walls = count_walls(v.data(), 4);
    // As an unsigned number a wall comes after all grains.
    const auto at = [&v](int k) { return static_cast<std::uint32_t>(v[k]); };
    const std::uint32_t first = std::min(std::min(at(0), at(1)), std::min(at(2), at(3)));
    key[c] = static_cast<std::uint32_t>(walls * grains + first);
    ++start[key[c] + 1];
    ++end[walls];
  }
  for (int k = 1; k < 4; ++k) end[k] += end[k - 1];
  for (std::size_t k = 1; k < start.size(); ++k) start[k] += start[k - 1];
  std::vector<std::int32_t> order(n);
  for (std::size_t c = 0; c < n; ++c) order[start[key[c]]++] = static_cast<std::int32_t>(c);
  return order;
}

// Fills facet arrays whose numbers by kind are known.
class FacetWriter {
 public:
  FacetWriter(FacetArrays& arrays, const std::array<std::size_t, 3>& count) : arrays_(arrays) {
    std::size_t total = 0;
    for (int walls = 0; walls < 3; ++walls) {
      next_[walls] = total;
      arrays.end[walls] = total += count[walls];
    }
    for (auto& v : arrays.vertex) v.resize(total);
    for (auto* v : {&arrays.left, &arrays.right, &arrays.left_apex, &arrays.right_apex}) v->resize(total);
  }

  void add(int walls, const std::array<Vertex, 3>& facet, std::int32_t left, std::int32_t right, Vertex left_apex,
           Vertex right_apex) {
    const std::size_t f = next_[walls]++;
    for (int k = 0; k < 3; ++k) arrays_.vertex[k][f] = facet[k];
    arrays_.left[f] = left;
    arrays_.right[f] = right;
    arrays_.left_apex[f] = left_apex;
    arrays_.right_apex[f] = right_apex;
  }

 private:
  FacetArrays& arrays_;
  std::array<std::size_t, 3> next_;
};

// Calls inner(walls, facet, cell, neighbour, apex, apex across) for each facet that has an own grain, once, and
// outer(walls, facet, cell, apex) for each other facet of an owned cell.
template <class Inner, class Outer>
void for_each_facet(const Mesh& mesh, const std::vector<std::array<std::int32_t, 4>>& neighbour, const LocalGrains& grains,
                    bool all_own, Inner inner, Outer outer) {
  const auto n = static_cast<std::int32_t>(mesh.cells());
  for (std::int32_t c = 0; c < n; ++c) {
    const std::array<Vertex, 4> v{mesh.cell_vertex[0][c], mesh.cell_vertex[1][c], mesh.cell_vertex[2][c], mesh.cell_vertex[3][c]};
    const bool walled = static_cast<std::size_t>(c) >= mesh.cell_end[0];
    for (int k = 0; k < 4; ++k) {
      const int* f = outward_facet[k];
      std::array<Vertex, 3> facet{v[f[0]], v[f[1]], v[f[2]]};
      int walls = 0;
      if (walled) {
        walls = count_walls(facet.data(), 3);
        if (walls == 3) continue;
        facet = grains_first(facet);
      }
      bool own = all_own;
      for (int i = 0; !own && i < 3 - walls; ++i) own = grains.own(facet[i]);
      if (!own) {
        if (mesh.owned[c]) outer(walls, facet, c, v[k]);
        continue;
      }
      const std::int32_t other = neighbour[c][k];
      if (other < c) continue;
      // The vertex across is the one that the two cells do not share.
      Vertex across = facet[0] ^ facet[1] ^ facet[2];
      for (int i = 0; i < 4; ++i) across ^= mesh.cell_vertex[i][other];
      inner(walls, facet, c, other, v[k], across);
    }
  }
}

}  // namespace

Vertex leading_vertex(const Vertex* vertex, int count, const LocalGrains& grains) {
  Vertex first = -1;
  for (int k = 0; k < count; ++k) {
    const Vertex v = vertex[k];
    if (is_wall(v)) continue;
    if (first < 0 || grains.id[v] < grains.id[first] ||
        (grains.id[v] == grains.id[first] && grains.shift[v] < grains.shift[first]))
      first = v;
  }
  return first;
}

bool belongs_here(const Vertex* vertex, int count, const LocalGrains& grains) {
  const Vertex first = leading_vertex(vertex, count, grains);
  return first >= 0 && grains.own(first);
}

Mesh make_mesh(const TouchingCells& cells, const LocalGrains& grains) {
  Mesh mesh;
  const auto order = sorted_order(cells, grains.size(), mesh.cell_end);
  const std::size_t n = order.size();
  std::vector<std::int32_t> rank_of(n);
  for (std::size_t c = 0; c < n; ++c) rank_of[order[c]] = static_cast<std::int32_t>(c);
  for (auto& v : mesh.cell_vertex) v.resize(n);
  mesh.owned = std::make_unique<bool[]>(n);
  if (!cells.previous.empty()) {
    mesh.previous.resize(n);
    for (std::size_t c = 0; c < n; ++c) mesh.previous[c] = cells.previous[order[c]];
  }
  const bool all_own = std::all_of(grains.source.begin(), grains.source.end(), [](std::int32_t s) { return s >= 0; });
  std::vector<std::array<std::int32_t, 4>> neighbour(n);
  for (std::size_t c = 0; c < n; ++c) {
    const auto& v = cells.vertex[order[c]];
    for (int k = 0; k < 4; ++k) {
      mesh.cell_vertex[k][c] = v[k];
      const std::int32_t other = cells.neighbour[order[c]][k];
      neighbour[c][k] = other < 0 ? -1 : rank_of[other];
    }
    mesh.owned[c] = all_own || belongs_here(v.data(), 4, grains);
  }

  std::array<std::size_t, 3> inner{}, outer{};
  for_each_facet(
      mesh, neighbour, grains, all_own, [&inner](int walls, auto&&...) { ++inner[walls]; },
      [&outer](int walls, auto&&...) { ++outer[walls]; });
  FacetWriter inner_facets(mesh.facet, inner), outer_facets(mesh.outer, outer);
  for_each_facet(
      mesh, neighbour, grains, all_own,
      [&](int walls, const auto& facet, std::int32_t c, std::int32_t other, Vertex apex, Vertex across) {
        inner_facets.add(walls, facet, c, other, apex, across);
      },
      [&](int walls, const auto& facet, std::int32_t c, Vertex apex) { outer_facets.add(walls, facet, c, -1, apex, -1); });
  return mesh;
}

}  // namespace poreslip
