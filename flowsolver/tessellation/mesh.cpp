#include "tessellation/mesh.hpp"

#include <algorithm>

#include "tessellation/orientation.hpp"

namespace poreslip {
namespace {

// Room for flips to add to, in shares of the whole: else the first that does would copy everything, and take twice the memory.
constexpr std::size_t spare_one_in = 64;

template <class T>
void resize_with_room(std::vector<T>& v, std::size_t size) {
  v.reserve(size + size / spare_one_in);
  v.resize(size);
}

// Order of cells by kind, then by lowest grain: a counting sort.
std::vector<std::int32_t> sorted_order(const LocalCells& cells, std::size_t grains, std::array<std::size_t, 6>& end) {
  const std::size_t n = cells.vertex.size();
  const std::size_t kinds = cells.touching == n ? 4 : 6;
  std::vector<std::uint32_t> key(n), start(kinds * grains + 1, 0);
  end = {};
  for (std::size_t c = 0; c < n; ++c) {
    const auto& v = cells.vertex[c];
    const int walls = count_walls(v.data(), 4), kind = c < cells.touching ? walls : 4 + (walls > 0);
    // As an unsigned number a wall comes after all grains.
    const auto at = [&v](int k) { return static_cast<std::uint32_t>(v[k]); };
    const std::uint32_t first = std::min(std::min(at(0), at(1)), std::min(at(2), at(3)));
    key[c] = static_cast<std::uint32_t>(kind * grains + first);
    ++start[key[c] + 1];
    ++end[kind];
  }
  for (int k = 1; k < 6; ++k) end[k] += end[k - 1];
  for (std::size_t k = 1; k < start.size(); ++k) start[k] += start[k - 1];
  std::vector<std::int32_t> order(n);
  for (std::size_t c = 0; c < n; ++c) order[start[key[c]]++] = static_cast<std::int32_t>(c);
  return order;
}

// Fills facet arrays whose numbers by kind are known.
class FacetWriter {
 public:
  FacetWriter(FacetArrays& arrays, const std::array<std::size_t, 5>& count) : arrays_(arrays) {
    std::size_t total = 0;
    for (int kind = 0; kind < 5; ++kind) {
      next_[kind] = total;
      arrays.end[kind] = total += count[kind];
    }
    for (auto& v : arrays.vertex) resize_with_room(v, total);
    for (auto* v : {&arrays.left, &arrays.right, &arrays.left_apex, &arrays.right_apex}) resize_with_room(*v, total);
  }

  std::int32_t add(int kind, const std::array<Vertex, 3>& facet, std::int32_t left, std::int32_t right, Vertex left_apex,
                   Vertex right_apex) {
    const std::size_t f = next_[kind]++;
    for (int k = 0; k < 3; ++k) arrays_.vertex[k][f] = facet[k];
    arrays_.left[f] = left;
    arrays_.right[f] = right;
    arrays_.left_apex[f] = left_apex;
    arrays_.right_apex[f] = right_apex;
    return static_cast<std::int32_t>(f);
  }

 private:
  FacetArrays& arrays_;
  std::array<std::size_t, 5> next_;
};

// Calls visit(kind, facet, cell, k, neighbour or -1) once for each facet between known cells, and for those of the mesh's cells that have
// no known neighbour.
template <class Visit>
void for_each_facet(const Mesh& mesh, const std::vector<std::array<std::int32_t, 4>>& neighbour, const LocalGrains& grains,
                    bool all_own, Visit visit) {
  const auto n = static_cast<std::int32_t>(mesh.all_cells()), touching = static_cast<std::int32_t>(mesh.cells());
  for (std::int32_t c = 0; c < n; ++c) {
    const std::array<Vertex, 4> v = mesh.vertices(c);
    const bool walled = static_cast<std::size_t>(c) >= mesh.cell_end[0];
    for (int k = 0; k < 4; ++k) {
      const std::int32_t other = neighbour[c][k];
      if (other < c && (other >= 0 || c >= touching)) continue;
      const int* f = outward_facet[k];
      std::array<Vertex, 3> facet{v[f[0]], v[f[1]], v[f[2]]};
      int walls = 0;
      if (walled) {
        walls = count_walls(facet.data(), 3);
        if (walls == 3) continue;
        facet = grains_first(facet);
      }
      const int kind = all_own || touches_own(facet.data(), 3, grains) ? walls : 3 + (walls > 0);
      visit(kind, facet, c, k, other);
    }
  }
}

bool knows_all(const LocalGrains& grains) {
  return std::all_of(grains.source.begin(), grains.source.end(), [](std::int32_t s) { return s >= 0; });
}

}  // namespace

bool touches_own(const Vertex* vertex, int count, const LocalGrains& grains) {
  for (int k = 0; k < count; ++k)
    if (!is_wall(vertex[k]) && grains.own(vertex[k])) return true;
  return false;
}

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
  // Of most all grains are own ones, whichever leads.
  bool all = true, any = false;
  for (int k = 0; k < count; ++k) {
    if (is_wall(vertex[k])) continue;
    const bool own = grains.own(vertex[k]);
    all = all && own;
    any = any || own;
  }
  return any && (all || grains.own(leading_vertex(vertex, count, grains)));
}

Mesh make_mesh(const LocalCells& cells, const LocalGrains& grains) {
  Mesh mesh;
  const auto order = sorted_order(cells, grains.size(), mesh.cell_end);
  const std::size_t n = order.size();
  std::vector<std::int32_t> rank_of(n);
  for (std::size_t c = 0; c < n; ++c) rank_of[order[c]] = static_cast<std::int32_t>(c);
  for (auto& v : mesh.cell_vertex) resize_with_room(v, n);
  mesh.owned = std::make_unique<bool[]>(cells.touching);
  if (!cells.previous.empty()) {
    mesh.previous.resize(cells.touching);
    for (std::size_t c = 0; c < cells.touching; ++c) mesh.previous[c] = cells.previous[order[c]];
  }
  const bool all_own = knows_all(grains);
  std::vector<std::array<std::int32_t, 4>> neighbour(n);
  constexpr std::size_t ahead = 16;  // cells asked of memory before they are needed
  for (std::size_t c = 0; c < n; ++c) {
    if (c + ahead < n) {
      __builtin_prefetch(&cells.vertex[order[c + ahead]]);
      __builtin_prefetch(&cells.neighbour[order[c + ahead]]);
    }
    const auto& v = cells.vertex[order[c]];
    for (int k = 0; k < 4; ++k) {
      mesh.cell_vertex[k][c] = v[k];
      const std::int32_t other = cells.neighbour[order[c]][k];
      neighbour[c][k] = other < 0 ? -1 : rank_of[other];
    }
    if (c < cells.touching) mesh.owned[c] = all_own || belongs_here(v.data(), 4, grains);
  }

  std::array<std::size_t, 5> count{};
  for_each_facet(mesh, neighbour, grains, all_own, [&count](int kind, auto&&...) { ++count[kind]; });
  for (auto& f : mesh.cell_facet) {
    resize_with_room(f, n);
    std::fill(f.begin(), f.end(), -1);
  }
  FacetWriter facets(mesh.facet, count);
  for_each_facet(mesh, neighbour, grains, all_own,
                 [&](int kind, const auto& facet, std::int32_t c, int k, std::int32_t other) {
                   Vertex across = -1;
                   int place = 0;
                   if (other >= 0) {
                     // The vertex across is the one that the two cells do not share.
                     across = facet[0] ^ facet[1] ^ facet[2];
                     for (int i = 0; i < 4; ++i) across ^= mesh.cell_vertex[i][other];
                     for (int i = 1; i < 4; ++i) place += i * (mesh.cell_vertex[i][other] == across);
                   }
                   const std::int32_t f = facets.add(kind, facet, c, other, mesh.cell_vertex[k][c], across);
                   mesh.cell_facet[k][c] = f;
                   if (other >= 0) mesh.cell_facet[place][other] = f;
                 });
  mesh.outer = outer_facets(mesh);
  return mesh;
}

Mesh sorted(const Mesh& mesh, const LocalGrains& grains) {
  LocalCells cells;
  const std::size_t n = mesh.all_cells();
  cells.touching = mesh.cells();
  cells.previous = mesh.previous;
  cells.vertex.resize(n);
  cells.neighbour.resize(n);
  for (std::size_t c = 0; c < n; ++c) {
    cells.vertex[c] = mesh.vertices(c);
    for (int k = 0; k < 4; ++k) cells.neighbour[c][k] = mesh.neighbour(c, k);
  }
  return make_mesh(cells, grains);
}

FacetArrays outer_facets(const Mesh& mesh) {
  FacetArrays outer;
  const FacetArrays& facet = mesh.facet;
  // Calls visit(walls, facet, cell, apex); from the right the facet turns the other way.
  const auto for_each = [&](auto visit) {
    for (std::size_t f = facet.end[2]; f < facet.end[4]; ++f) {
      std::array<Vertex, 3> v{facet.vertex[0][f], facet.vertex[1][f], facet.vertex[2][f]};
      const int walls = count_walls(v.data(), 3);
      const auto owned = [&mesh](std::int32_t c) { return c >= 0 && static_cast<std::size_t>(c) < mesh.cells() && mesh.owned[c]; };
      if (owned(facet.left[f])) visit(walls, v, facet.left[f], facet.left_apex[f]);
      if (!owned(facet.right[f])) continue;
      if (walls == 2) std::swap(v[1], v[2]);
      else std::swap(v[0], v[1]);
      visit(walls, v, facet.right[f], facet.right_apex[f]);
    }
  };
  std::array<std::size_t, 5> count{};
  for_each([&count](int walls, auto&&...) { ++count[walls]; });
  FacetWriter writer(outer, count);
  for_each([&writer](int walls, const auto& v, std::int32_t cell, Vertex apex) { writer.add(walls, v, cell, -1, apex, -1); });
  return outer;
}

std::vector<std::size_t> facets_at_walls(const Mesh& mesh) {
  std::vector<std::size_t> found;
  for (std::size_t c = mesh.cell_end[0]; c < mesh.cell_end[3]; ++c)
    for (int k = 0; k < 4; ++k) {
      const std::int32_t f = mesh.cell_facet[k][c];
      if (f < 0 || static_cast<std::size_t>(f) >= mesh.facets()) continue;
      // One between two such cells is the left one's.
      if (mesh.facet.left[f] == static_cast<std::int32_t>(c) || !mesh.walled(mesh.facet.left[f])) found.push_back(f);
    }
  return found;
}

}  // namespace poreslip
