#include "tessellation/flips.hpp"

#include <algorithm>
#include <cstdint>
#include <deque>

#include "tessellation/predicates.hpp"

namespace poreslip {
namespace {

// More flips than this for each facet that was violated: rather triangulate anew.
constexpr std::size_t flips_per_violation = 50;

using Cell = std::array<Vertex, 4>;
using Facet = std::array<Vertex, 3>;
constexpr int outward_facet[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

// A rotation, which keeps the normal, that puts a grain first.
Facet grain_first(Facet f) {
  while (is_wall(f[0])) f = {f[1], f[2], f[0]};
  return f;
}

class Flipper {
 public:
  Flipper(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls) : grains_(grains), walls_(walls) {
    const std::size_t n = before_ = mesh.cells();
    vertex_.resize(n);
    neighbour_.assign(n, {-1, -1, -1, -1});
    alive_.assign(n, true);
    for (std::size_t c = 0; c < n; ++c)
      for (int k = 0; k < 4; ++k) vertex_[c][k] = mesh.cell_vertex[k][c];
    for (std::size_t f = 0; f < mesh.facets(); ++f) {
      neighbour_[mesh.facet.left[f]][place(mesh.facet.left[f], mesh.facet.left_apex[f])] = mesh.facet.right[f];
      neighbour_[mesh.facet.right[f]][place(mesh.facet.right[f], mesh.facet.right_apex[f])] = mesh.facet.left[f];
    }
  }

  bool run(const Mesh& mesh, const std::vector<std::size_t>& violated) {
    for (const std::size_t f : violated) queue_.push_back({mesh.facet.left[f], mesh.facet.left_apex[f]});
    std::size_t budget = 1000 + flips_per_violation * violated.size(), stuck = 0;
    // A facet that cannot be flipped now waits for the others; when all that are left wait, nothing moves any more.
    while (!queue_.empty() && stuck < 2 * queue_.size() + 2) {
      const auto [cell, apex] = queue_.front();
      queue_.pop_front();
      if (!alive_[cell]) continue;
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
    return queue_.empty();
  }

  TouchingCells result() const {
    std::vector<std::int32_t> number(vertex_.size(), -1);
    TouchingCells cells;
    for (std::size_t c = 0; c < vertex_.size(); ++c) {
      if (!alive_[c]) continue;
      number[c] = static_cast<std::int32_t>(cells.vertex.size());
      cells.vertex.push_back(vertex_[c]);
      cells.neighbour.push_back(neighbour_[c]);
      cells.previous.push_back(c < before_ ? static_cast<std::int32_t>(c) : -1);
    }
    for (std::size_t c = 0; c < cells.vertex.size(); ++c) {
      for (auto& n : cells.neighbour[c]) n = n < 0 ? -1 : number[n];
      grains_before_walls(cells.vertex[c], cells.neighbour[c]);
    }
    return cells;
  }

 private:
  enum class Step { regular, flipped, waits };

  int place(std::int32_t cell, Vertex v) const {
    const auto& c = vertex_[cell];
    return static_cast<int>(std::find(c.begin(), c.end(), v) - c.begin());
  }
  bool has(std::int32_t cell, Vertex v) const { return place(cell, v) < 4; }

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
    const auto& v = vertex_[outer];
    for (int k = 0; k < 4; ++k)
      if (std::find(facet.begin(), facet.end(), v[k]) == facet.end()) neighbour_[outer][k] = to;
  }

  std::int32_t add(const Cell& v) {
    vertex_.push_back(v);
    neighbour_.push_back({-1, -1, -1, -1});
    alive_.push_back(true);
    return static_cast<std::int32_t>(vertex_.size() - 1);
  }

  void test_later(std::int32_t cell, Vertex apex) {
    if (neighbour_[cell][place(cell, apex)] >= 0) queue_.push_back({cell, apex});
  }

  // Flips the facet opposite vertex k of a cell if it fails the power test and can be flipped.
  Step improve(std::int32_t left, int k) {
    const std::int32_t right = neighbour_[left][k];
    if (right < 0) return Step::regular;
    const Cell v = vertex_[left];
    const int* o = outward_facet[k];
    Facet f{v[o[0]], v[o[1]], v[o[2]]};
    if (is_wall(f[0]) && is_wall(f[1]) && is_wall(f[2])) return Step::regular;
    f = grain_first(f);
    const Vertex d = v[k];
    Vertex e = d;
    for (const Vertex w : vertex_[right])
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
      below[i] = neighbour_[left][place(left, off)];
      above[i] = neighbour_[right][place(right, off)];
    }
    for (int i = 0; i < 3; ++i) made[i] = add({f[i], f[(i + 1) % 3], d, e});
    alive_[left] = alive_[right] = false;
    for (int i = 0; i < 3; ++i) {
      const Vertex p = f[i], q = f[(i + 1) % 3];
      // Opposite p lies the cell at the next edge, opposite q the one at the edge before.
      neighbour_[made[i]] = {made[(i + 1) % 3], made[(i + 2) % 3], above[i], below[i]};
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
    const std::int32_t third = neighbour_[left][place(left, c)];
    if (third < 0 || third != neighbour_[right][place(right, c)] || !has(third, d) || !has(third, e)) return Step::waits;
    const int side_a = orientation({c, d, e, a}), side_b = orientation({c, d, e, b});
    if (side_a * side_b >= 0) return Step::waits;
    std::int32_t made[2];
    const Vertex end[2] = {a, b};
    std::int32_t outer[2][3];
    for (int s = 0; s < 2; ++s) {
      const Vertex gone = end[1 - s];
      outer[s][0] = neighbour_[third][place(third, gone)];  // opposite c
      outer[s][1] = neighbour_[right][place(right, gone)];  // opposite d
      outer[s][2] = neighbour_[left][place(left, gone)];    // opposite e
    }
    for (int s = 0; s < 2; ++s) {
      const bool positive = (s == 0 ? side_a : side_b) > 0;
      made[s] = add(positive ? Cell{c, d, e, end[s]} : Cell{d, c, e, end[s]});
    }
    alive_[left] = alive_[right] = alive_[third] = false;
    for (int s = 0; s < 2; ++s) {
      auto& n = neighbour_[made[s]];
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

  const LocalGrains& grains_;
  const WallSpheres& walls_;
  std::vector<Cell> vertex_;
  std::vector<std::array<std::int32_t, 4>> neighbour_;
  std::vector<bool> alive_;
  std::deque<std::pair<std::int32_t, Vertex>> queue_;  // a cell and the apex opposite the facet in question
  std::size_t before_ = 0;  // cells of the mesh at the start
  std::int64_t exact_tests_ = 0;
};

}  // namespace

std::optional<TouchingCells> flip(const Mesh& mesh, const LocalGrains& grains, const WallSpheres& walls,
                                  const std::vector<std::size_t>& violated) {
  Flipper flipper(mesh, grains, walls);
  if (!flipper.run(mesh, violated)) return std::nullopt;
  return flipper.result();
}

}  // namespace poreslip
