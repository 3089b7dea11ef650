#include "tessellation/flips.hpp"

#include <algorithm>
#include <deque>
#include <unordered_map>

#include "tessellation/orientation.hpp"
#include "tessellation/predicates.hpp"

namespace poreslip {
namespace {

// More flips than this for each facet that was violated: rather triangulate anew.
constexpr std::size_t flips_per_violation = 50;

using Cell = std::array<Vertex, 4>;
using Facet = std::array<Vertex, 3>;

// Cells are numbered as in the mesh, those that flips make after all of these. What flips touch is copied; the mesh stays as it is.
class Flipper {
 public:
  Flipper(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls, const std::vector<std::int32_t>& inverted)
      : mesh_(mesh), grains_(grains), walls_(walls), first_new_(static_cast<std::int32_t>(mesh.all_cells())) {
    for (const std::int32_t c : inverted) at(c).inverted = true;
  }

  bool run(const std::vector<std::size_t>& violated) {
    for (const std::size_t f : violated) queue_.push_back({mesh_.facet.left[f], mesh_.facet.left_apex[f]});
    std::size_t budget = 1000 + flips_per_violation * violated.size(), stuck = 0;
    // A facet that cannot be flipped now waits for the others; when all that are left wait, nothing moves any more.
    while (!queue_.empty() && stuck < 2 * queue_.size() + 2) {
      const auto [cell, apex] = queue_.front();
      queue_.pop_front();
      if (!at(cell).alive) continue;
      switch (improve(cell, place(cell, apex))) {
        case Step::regular: break;
        case Step::flipped:
          stuck = 0;
          if (budget-- == 0) return false;
          break;
        case Step::waits:
          ++stuck;
          queue_.push_back({cell, apex});
          break;
      }
    }
    // Those without an own grain are another rank's to clear.
    return std::none_of(queue_.begin(), queue_.end(), [this](const auto& waiting) {
      const auto [cell, apex] = waiting;
      if (!at(cell).alive) return false;
      const int* o = outward_facet[place(cell, apex)];
      const Cell v = at(cell).vertex;
      const Facet f{v[o[0]], v[o[1]], v[o[2]]};
      return touches_own(f.data(), 3, grains_);
    });
  }

  Flips result() const {
    Flips flips;
    std::unordered_map<std::int32_t, std::int32_t> added;  // by their numbers here
    for (std::size_t w = 0; w < work_.size(); ++w) {
      const Work& cell = work_[w];
      if (cell.base >= 0) {
        if (!cell.alive) flips.removed.push_back(cell.base);
      } else if (cell.alive) {
        added[first_new_ + static_cast<std::int32_t>(w)] = static_cast<std::int32_t>(flips.added.size());
        flips.added.push_back(cell.vertex);
        flips.neighbour.push_back(cell.neighbour);
      }
    }
    for (std::size_t c = 0; c < flips.added.size(); ++c) {
      for (auto& n : flips.neighbour[c])
        if (n >= first_new_) n = -2 - added.at(n);
      grains_before_walls(flips.added[c], flips.neighbour[c]);
    }
    return flips;
  }

 private:
  struct Work {
    Cell vertex;
    std::array<std::int32_t, 4> neighbour;
    std::int32_t base;      // its number in the mesh, -1 for a new cell
    bool alive = true;
    bool inverted = false;  // nothing next to it is flipped
  };
  enum class Step { regular, flipped, waits };

  Work& at(std::int32_t cell) {
    if (cell >= first_new_) return work_[cell - first_new_];
    const auto [place, missing] = work_of_base_.try_emplace(cell, work_.size());
    if (missing) {
      work_.push_back({mesh_.vertices(cell), {}, cell});
      for (int k = 0; k < 4; ++k) work_.back().neighbour[k] = mesh_.neighbour(cell, k);
    }
    return work_[place->second];
  }
  int place(std::int32_t cell, Vertex v) {
    const auto& c = at(cell).vertex;
    return static_cast<int>(std::find(c.begin(), c.end(), v) - c.begin());
  }
  bool has(std::int32_t cell, Vertex v) { return place(cell, v) < 4; }
  std::int32_t neighbour_off(std::int32_t cell, Vertex v) {
    const Work& c = at(cell);
    return c.neighbour[std::find(c.vertex.begin(), c.vertex.end(), v) - c.vertex.begin()];
  }

  // Keeps the orientation: an odd permutation is made even within the grains, or within the three walls of a corner.
  static void grains_before_walls(Cell& v, std::array<std::int32_t, 4>& n) {
    bool odd = false;
    const auto exchange = [&](int p, int q) {
      std::swap(v[p], v[q]);
      std::swap(n[p], n[q]);
      odd = !odd;
    };
    for (int p = 0; p < 4; ++p)
      for (int q = p + 1; q < 4 && is_wall(v[p]); ++q)
        if (!is_wall(v[q])) exchange(p, q);
    if (odd) is_wall(v[1]) ? exchange(2, 3) : exchange(0, 1);
  }

  int orientation(Cell c) {
    // Moving a grain to the front by two exchanges keeps the sign.
    for (int k = 1; k < 4 && is_wall(c[0]); ++k) {
      if (is_wall(c[k])) continue;
      const int p = k == 3 ? 1 : 3, q = 6 - k - p;
      std::swap(c[0], c[k]);
      std::swap(c[p], c[q]);
    }
    if (is_wall(c[0])) return exact_orientation(grains_, walls_, c);
    return orientation_sign(grains_, walls_, c, exact_tests_);
  }

  void link(std::int32_t outer, const Facet& facet, std::int32_t to) {
    if (outer < 0) return;
    Work& cell = at(outer);
    for (int k = 0; k < 4; ++k)
      if (std::find(facet.begin(), facet.end(), cell.vertex[k]) == facet.end()) cell.neighbour[k] = to;
  }

  std::int32_t add(const Cell& v) {
    work_.push_back({v, {-1, -1, -1, -1}, -1});
    return first_new_ + static_cast<std::int32_t>(work_.size() - 1);
  }

  void test_later(std::int32_t cell, Vertex apex) {
    if (neighbour_off(cell, apex) >= 0) queue_.push_back({cell, apex});
  }

  // Flips the facet opposite vertex k of a cell if it fails the power test and can be flipped.
  Step improve(std::int32_t left, int k) {
    const std::int32_t right = at(left).neighbour[k];
    if (right < 0) return Step::regular;
    if (at(left).inverted || at(right).inverted) return Step::waits;
    const Cell v = at(left).vertex;
    const int* o = outward_facet[k];
    Facet f{v[o[0]], v[o[1]], v[o[2]]};
    if (is_wall(f[0]) && is_wall(f[1]) && is_wall(f[2])) return Step::regular;
    f = grains_first(f);
    const Vertex d = v[k];
    Vertex e = d;
    for (const Vertex w : at(right).vertex)
      if (w != f[0] && w != f[1] && w != f[2]) e = w;
    if (violation_sign(grains_, walls_, f, d, e, exact_tests_) <= 0) return Step::regular;
    int reflex = -1, count = 0;
    for (int i = 0; i < 3; ++i) {
      const int sign = orientation({f[i], f[(i + 1) % 3], d, e});
      if (sign == 0) return Step::waits;
      if (sign < 0) {
        reflex = i;
        ++count;
      }
    }
    if (count == 0) return two_to_three(left, right, f, d, e);
    if (count == 1) return three_to_two(left, right, f[reflex], f[(reflex + 1) % 3], f[(reflex + 2) % 3], d, e);
    return Step::waits;
  }

  Step two_to_three(std::int32_t left, std::int32_t right, const Facet& f, Vertex d, Vertex e) {
    std::int32_t below[3], above[3], made[3];
    for (int i = 0; i < 3; ++i) {
      const Vertex off = f[(i + 2) % 3];
      below[i] = neighbour_off(left, off);
      above[i] = neighbour_off(right, off);
    }
    for (int i = 0; i < 3; ++i) made[i] = add({f[i], f[(i + 1) % 3], d, e});
    at(left).alive = at(right).alive = false;
    for (int i = 0; i < 3; ++i) {
      const Vertex p = f[i], q = f[(i + 1) % 3];
      // Opposite p lies the cell at the next edge, opposite q the one at the edge before.
      at(made[i]).neighbour = {made[(i + 1) % 3], made[(i + 2) % 3], above[i], below[i]};
      link(above[i], {p, q, e}, made[i]);
      link(below[i], {p, q, d}, made[i]);
    }
    for (int i = 0; i < 3; ++i) {
      test_later(made[i], d);
      test_later(made[i], e);
    }
    return Step::flipped;
  }

  // The edge (a, b) goes, if just three cells are around it: abcd, abce and abde.
  Step three_to_two(std::int32_t left, std::int32_t right, Vertex a, Vertex b, Vertex c, Vertex d, Vertex e) {
    const std::int32_t third = neighbour_off(left, c);
    if (third < 0 || third != neighbour_off(right, c) || !has(third, d) || !has(third, e) || at(third).inverted) return Step::waits;
    const int side_a = orientation({c, d, e, a}), side_b = orientation({c, d, e, b});
    if (side_a * side_b >= 0) return Step::waits;
    std::int32_t made[2];
    const Vertex end[2] = {a, b};
    std::int32_t outer[2][3];
    for (int s = 0; s < 2; ++s) {
      const Vertex gone = end[1 - s];
      outer[s][0] = neighbour_off(third, gone);  // opposite c
      outer[s][1] = neighbour_off(right, gone);  // opposite d
      outer[s][2] = neighbour_off(left, gone);   // opposite e
    }
    for (int s = 0; s < 2; ++s) {
      const bool positive = (s == 0 ? side_a : side_b) > 0;
      made[s] = add(positive ? Cell{c, d, e, end[s]} : Cell{d, c, e, end[s]});
    }
    at(left).alive = at(right).alive = at(third).alive = false;
    for (int s = 0; s < 2; ++s) {
      auto& n = at(made[s]).neighbour;
      n[place(made[s], c)] = outer[s][0];
      n[place(made[s], d)] = outer[s][1];
      n[place(made[s], e)] = outer[s][2];
      n[3] = made[1 - s];
      link(outer[s][0], {d, e, end[s]}, made[s]);
      link(outer[s][1], {c, e, end[s]}, made[s]);
      link(outer[s][2], {c, d, end[s]}, made[s]);
    }
    for (int s = 0; s < 2; ++s)
      for (const Vertex apex : {c, d, e}) test_later(made[s], apex);
    return Step::flipped;
  }

  const Mesh& mesh_;
  const LocalGrains& grains_;
  const WallSpheres& walls_;
  const std::int32_t first_new_;
  std::vector<Work> work_;  // a new cell is number first_new_ + its place here
  std::unordered_map<std::int32_t, std::size_t> work_of_base_;
  std::deque<std::pair<std::int32_t, Vertex>> queue_;  // a cell and the apex opposite the facet in question
  std::int64_t exact_tests_ = 0;
};

}  // namespace

std::optional<Flips> flip(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls, const Certificate& certificate) {
  Flipper flipper(mesh, grains, walls, certificate.inverted_around);
  if (!flipper.run(certificate.violated_facets)) return std::nullopt;
  return flipper.result();
}

}  // namespace poreslip
