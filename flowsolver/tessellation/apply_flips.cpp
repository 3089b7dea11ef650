// Flips carried out on a mesh: what they do not touch stays where it is.
#include <algorithm>
#include <unordered_map>

#include "tessellation/flips.hpp"
#include "tessellation/orientation.hpp"

namespace poreslip {
namespace {

// Once flips have made this share of the cells, they are sorted anew: the kernels live on neighbours that lie together.
constexpr std::size_t sort_one_in = 8;

// Room in an array whose elements are sorted by kind, end[kind] past the last of each: `freed` places of each kind go, `wanted` new ones
// are made. move(from, to) moves an element, resize(size) all arrays. Returns the places of the new ones by kind.
template <std::size_t Kinds, class Move, class Resize>
std::array<std::vector<std::size_t>, Kinds> make_room(std::array<std::size_t, Kinds>& end, std::array<std::vector<std::size_t>, Kinds> freed,
                                                      const std::array<std::size_t, Kinds>& wanted, Move move, Resize resize) {
  std::array<std::vector<std::size_t>, Kinds> room;
  // New ones take freed places first.
  for (std::size_t kind = 0; kind < Kinds; ++kind)
    while (room[kind].size() < wanted[kind] && !freed[kind].empty()) {
      room[kind].push_back(freed[kind].back());
      freed[kind].pop_back();
    }
  // Other freed places are filled from the kind's end, and the kinds after it move up.
  std::size_t begin = 0, gap = 0;
  for (std::size_t kind = 0; kind < Kinds; ++kind) {
    std::size_t last = end[kind];
    std::sort(freed[kind].rbegin(), freed[kind].rend());
    for (const std::size_t place : freed[kind])
      if (--last != place) {
        move(last, place);
        std::replace(room[kind].begin(), room[kind].end(), last, place);
      }
    const std::size_t size = last - begin, moved = std::min(size, gap);
    for (std::size_t k = 0; k < moved; ++k) {
      const std::size_t from = last - moved + k, to = begin - gap + k;
      move(from, to);
      std::replace(room[kind].begin(), room[kind].end(), from, to);
    }
    begin = end[kind];
    end[kind] = last - gap;
    gap = begin - end[kind];
  }
  // What is still wanted goes to the kind's end, and the kinds after it move down.
  std::size_t more = 0;
  for (std::size_t kind = 0; kind < Kinds; ++kind) more += wanted[kind] - room[kind].size();
  resize(end.back() + more);
  for (std::size_t kind = Kinds; kind-- > 0;) {
    const std::size_t own = wanted[kind] - room[kind].size(), shift = more - own;
    const std::size_t first = kind > 0 ? end[kind - 1] : 0, size = end[kind] - first, moved = std::min(size, shift);
    for (std::size_t k = 0; k < moved; ++k) {
      const std::size_t from = first + k, to = end[kind] + shift - moved + k;
      move(from, to);
      std::replace(room[kind].begin(), room[kind].end(), from, to);
    }
    for (std::size_t k = 0; k < own; ++k) room[kind].push_back(end[kind] + shift + k);
    end[kind] += more;
    more = shift;
  }
  return room;
}

template <std::size_t Kinds>
std::size_t kind_at(const std::array<std::size_t, Kinds>& end, std::size_t place) {
  return static_cast<std::size_t>(std::upper_bound(end.begin(), end.end(), place) - end.begin());
}

struct NewFacet {
  std::array<Vertex, 3> vertex;
  std::size_t left_added;   // index among the added cells
  int left_place;           // of its apex
  std::int32_t right;       // as in Flips
};

class Application {
 public:
  Application(const Flips& flips, const LocalGrains& grains, Mesh& mesh) : flips_(flips), grains_(grains), mesh_(mesh) {}

  void run() {
    const std::vector<std::int32_t> gone = detach_facets();
    replace_cells();
    replace_facets(gone);
    if (mesh_.facet.size() < mesh_.facet.all()) mesh_.outer = outer_facets(mesh_);
    mesh_.changed += flips_.added.size();
  }

 private:
  std::int32_t& facet_of(std::int32_t cell, Vertex apex) {
    int k = 0;
    while (mesh_.cell_vertex[k][cell] != apex) ++k;
    return mesh_.cell_facet[k][cell];
  }

  // Facets of the cells that go, off the cells on both sides.
  std::vector<std::int32_t> detach_facets() {
    std::vector<std::int32_t> gone;
    FacetArrays& facet = mesh_.facet;
    for (const std::int32_t c : flips_.removed)
      for (auto& of_cell : mesh_.cell_facet) {
        const std::int32_t f = of_cell[c];
        if (f < 0) continue;
        gone.push_back(f);
        facet_of(facet.left[f], facet.left_apex[f]) = -1;
        if (facet.right[f] >= 0) facet_of(facet.right[f], facet.right_apex[f]) = -1;
      }
    return gone;
  }

  void replace_cells() {
    const std::size_t before = mesh_.cells();
    mesh_.previous.resize(before);
    for (std::size_t c = 0; c < before; ++c) mesh_.previous[c] = static_cast<std::int32_t>(c);

    std::array<std::vector<std::size_t>, 6> freed;
    for (const std::int32_t c : flips_.removed) freed[kind_at(mesh_.cell_end, c)].push_back(c);
    std::array<std::size_t, 6> wanted{};
    std::vector<std::size_t> kind(flips_.added.size());
    for (std::size_t a = 0; a < kind.size(); ++a) {
      const auto& v = flips_.added[a];
      const int walls = count_walls(v.data(), 4);
      kind[a] = touches_own(v.data(), 4, grains_) ? walls : 4 + (walls > 0);
      ++wanted[kind[a]];
    }
    // Room for both the old and the new ones.
    auto owned = std::make_unique<bool[]>(before + wanted[0] + wanted[1] + wanted[2] + wanted[3]);
    std::copy_n(mesh_.owned.get(), before, owned.get());
    mesh_.owned = std::move(owned);

    const auto move = [this](std::size_t from, std::size_t to) { move_cell(from, to); };
    const auto resize = [this](std::size_t size) {
      for (auto& v : mesh_.cell_vertex) v.resize(size);
      for (auto& v : mesh_.cell_facet) v.resize(size);
      mesh_.previous.resize(std::max(mesh_.previous.size(), size));
    };
    auto room = make_room(mesh_.cell_end, std::move(freed), wanted, move, resize);
    mesh_.previous.resize(mesh_.cells());

    place_.resize(kind.size());
    for (std::size_t a = 0; a < kind.size(); ++a) {
      const std::size_t c = room[kind[a]].back();
      room[kind[a]].pop_back();
      place_[a] = static_cast<std::int32_t>(c);
      const auto& v = flips_.added[a];
      for (int k = 0; k < 4; ++k) {
        mesh_.cell_vertex[k][c] = v[k];
        mesh_.cell_facet[k][c] = -1;
      }
      if (kind[a] > 3) continue;
      mesh_.owned[c] = belongs_here(v.data(), 4, grains_);
      mesh_.previous[c] = -1;
    }
  }

  void move_cell(std::size_t from, std::size_t to) {
    for (auto& v : mesh_.cell_vertex) v[to] = v[from];
    for (auto& of_cell : mesh_.cell_facet) {
      const std::int32_t f = of_cell[to] = of_cell[from];
      if (f < 0) continue;
      auto& side = mesh_.facet.left[f] == static_cast<std::int32_t>(from) ? mesh_.facet.left[f] : mesh_.facet.right[f];
      side = static_cast<std::int32_t>(to);
    }
    // Kinds keep together, so that both places are of cells that touch own grains, or neither.
    if (kind_at(mesh_.cell_end, from) < 4 && from < mesh_.previous.size()) {
      mesh_.owned[to] = mesh_.owned[from];
      mesh_.previous[to] = mesh_.previous[from];
    }
    const auto origin = origin_.find(from);
    const std::size_t was = origin == origin_.end() ? from : origin->second;
    if (origin != origin_.end()) origin_.erase(origin);
    origin_[to] = was;
    moved_to_[was] = to;
  }

  std::int32_t cell_of(std::int32_t neighbour) const {
    if (neighbour <= -2) return place_[-2 - neighbour];
    if (neighbour < 0) return -1;
    const auto found = moved_to_.find(neighbour);
    return found == moved_to_.end() ? neighbour : static_cast<std::int32_t>(found->second);
  }

  void replace_facets(const std::vector<std::int32_t>& gone) {
    FacetArrays& facet = mesh_.facet;
    std::array<std::vector<std::size_t>, 5> freed;
    for (const std::int32_t f : gone) {
      freed[kind_at(facet.end, f)].push_back(f);
      // Whatever is moved with the others refers to no cell.
      facet.left[f] = facet.right[f] = -1;
    }
    std::array<std::size_t, 5> wanted{};
    std::array<std::vector<NewFacet>, 5> made;
    for (std::size_t a = 0; a < flips_.added.size(); ++a) {
      const auto& v = flips_.added[a];
      const bool touching = static_cast<std::size_t>(place_[a]) < mesh_.cells();
      for (int k = 0; k < 4; ++k) {
        const std::int32_t other = flips_.neighbour[a][k];
        if ((other == -1 && !touching) || (other <= -2 && static_cast<std::size_t>(-2 - other) < a)) continue;
        const int* o = outward_facet[k];
        std::array<Vertex, 3> f{v[o[0]], v[o[1]], v[o[2]]};
        const int walls = count_walls(f.data(), 3);
        if (walls == 3) continue;
        f = grains_first(f);
        const int kind = touches_own(f.data(), 3, grains_) ? walls : 3 + (walls > 0);
        made[kind].push_back({f, a, k, other});
        ++wanted[kind];
      }
    }
    const auto for_all = [&facet](auto visit) {
      for (auto& v : facet.vertex) visit(v);
      for (auto* v : {&facet.left, &facet.right, &facet.left_apex, &facet.right_apex}) visit(*v);
    };
    const auto move = [&](std::size_t from, std::size_t to) {
      for_all([from, to](auto& v) { v[to] = v[from]; });
      const auto refer = [&](std::int32_t cell) {
        for (auto& of_cell : mesh_.cell_facet)
          if (cell >= 0 && of_cell[cell] == static_cast<std::int32_t>(from)) of_cell[cell] = static_cast<std::int32_t>(to);
      };
      refer(facet.left[to]);
      refer(facet.right[to]);
    };
    const auto room = make_room(facet.end, std::move(freed), wanted, move, [&for_all](std::size_t size) {
      for_all([size](auto& v) { v.resize(size); });
    });
    for (int kind = 0; kind < 5; ++kind)
      for (std::size_t m = 0; m < made[kind].size(); ++m) write(made[kind][m], room[kind][m]);
  }

  void write(const NewFacet& made, std::size_t f) {
    FacetArrays& facet = mesh_.facet;
    const std::int32_t left = place_[made.left_added], right = cell_of(made.right);
    for (int k = 0; k < 3; ++k) facet.vertex[k][f] = made.vertex[k];
    facet.left[f] = left;
    facet.right[f] = right;
    facet.left_apex[f] = flips_.added[made.left_added][made.left_place];
    facet.right_apex[f] = -1;
    mesh_.cell_facet[made.left_place][left] = static_cast<std::int32_t>(f);
    if (right < 0) return;
    Vertex across = made.vertex[0] ^ made.vertex[1] ^ made.vertex[2];
    for (int k = 0; k < 4; ++k) across ^= mesh_.cell_vertex[k][right];
    facet.right_apex[f] = across;
    facet_of(right, across) = static_cast<std::int32_t>(f);
  }

  const Flips& flips_;
  const LocalGrains& grains_;
  Mesh& mesh_;
  std::vector<std::int32_t> place_;                           // of the added cells
  std::unordered_map<std::size_t, std::size_t> moved_to_;     // cells of before that have moved
  std::unordered_map<std::size_t, std::size_t> origin_;       // where those now at a place were before
};

}  // namespace

void apply(const Flips& flips, const LocalGrains& grains, Mesh& mesh) {
  Application(flips, grains, mesh).run();
  if (mesh.changed * sort_one_in > mesh.all_cells()) mesh = sorted(mesh, grains);
}

}  // namespace poreslip
