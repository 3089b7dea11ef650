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
  std::vector<std::size_t> key(n), start(4 * grains + 1, 0);
  end = {0, 0, 0, 0};
  for (std::size_t c = 0; c < n; ++c) {
    const auto& v = cells.vertex[c];
    const int walls = count_walls(v.data(), 4);
    const Vertex first = *std::min_element(v.begin(), v.begin() + (4 - walls));
    key[c] = walls * grains + first;
    ++start[key[c] + 1];
    ++end[walls];
  }
  for (int k = 1; k < 4; ++k) end[k] += end[k - 1];
  for (std::size_t k = 1; k < start.size(); ++k) start[k] += start[k - 1];
  std::vector<std::int32_t> order(n);
  for (std::size_t c = 0; c < n; ++c) order[start[key[c]]++] = static_cast<std::int32_t>(c);
  return order;
}

struct Facet {
  std::array<Vertex, 3> vertex;
  std::int32_t left, right;
  Vertex left_apex, right_apex;
};
using FacetKinds = std::array<std::vector<Facet>, 3>;  // by number of walls

FacetArrays arrays(FacetKinds& kinds) {
  FacetArrays a;
  std::size_t total = 0;
  for (int walls = 0; walls < 3; ++walls) a.end[walls] = total += kinds[walls].size();
  for (auto& v : a.vertex) v.reserve(total);
  for (auto* v : {&a.left, &a.right, &a.left_apex, &a.right_apex}) v->reserve(total);
  for (auto& kind : kinds) {
    for (const Facet& f : kind) {
      for (int k = 0; k < 3; ++k) a.vertex[k].push_back(f.vertex[k]);
      a.left.push_back(f.left);
      a.right.push_back(f.right);
      a.left_apex.push_back(f.left_apex);
      a.right_apex.push_back(f.right_apex);
    }
    std::vector<Facet>().swap(kind);
  }
  return a;
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

  FacetKinds inner, outer;
  inner[0].reserve(2 * n + 16);
  for (std::size_t c = 0; c < n; ++c) {
    const auto& v = cells.vertex[order[c]];
    const auto& neighbour = cells.neighbour[order[c]];
    for (int k = 0; k < 4; ++k) mesh.cell_vertex[k][c] = v[k];
    mesh.owned[c] = belongs_here(v.data(), 4, grains);
    for (int k = 0; k < 4; ++k) {
      const int* f = outward_facet[k];
      std::array<Vertex, 3> facet{v[f[0]], v[f[1]], v[f[2]]};
      const int walls = count_walls(facet.data(), 3);
      if (walls == 3) continue;
      facet = grains_first(facet);
      bool own = false;
      for (int i = 0; i < 3 - walls; ++i) own = own || grains.own(facet[i]);
      if (!own) {
        if (mesh.owned[c]) outer[walls].push_back({facet, static_cast<std::int32_t>(c), -1, v[k], -1});
        continue;
      }
      const std::int32_t other = rank_of[neighbour[k]];
      if (other < static_cast<std::int32_t>(c)) continue;
      const auto on_facet = [&](Vertex w) { return w == facet[0] || w == facet[1] || w == facet[2]; };
      const auto& across = cells.vertex[neighbour[k]];
      int back = 0;
      while (on_facet(across[back])) ++back;
      inner[walls].push_back({facet, static_cast<std::int32_t>(c), other, v[k], across[back]});
    }
  }
  mesh.facet = arrays(inner);
  mesh.outer = arrays(outer);
  return mesh;
}

}  // namespace poreslip
