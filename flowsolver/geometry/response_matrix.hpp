// What the forces of pressures in cells become once grains and walls have moved, without a look at the cells: dF = -K u with
// K = sum_c s_c g_c g_c^T, g_c = dV_c/dx and s_c = 1 / (beta V_c). K is symmetric: one block serves both ends of an edge, and all
// cells around it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "geometry/cell_response.hpp"
#include "geometry/huge_pages.hpp"

namespace poreslip::geometry {

// Part of a cell's boundary on a wall. The wall's displacement along its normal, outward, is the first component of that of a body.
struct Roof {
  std::size_t cell;
  std::int32_t body;
  double area;  // m^2
};

// Bodies are what moves, grains first.
class ResponseMatrix {
 public:
  // Finds K's blocks. counted (cells): those that enter the sum. roofs: by cells, ascending. A vertex that is a wall is listed in cells.grain as
  // the body `wall`, which has none.
  void connect(const CellGradients& cells, const bool* counted, const std::vector<Roof>& roofs, std::size_t bodies, std::int32_t wall);

  // Sets K for the same cells and roofs, whose gradients and areas may have changed. stiffness (cells): s, Pa/m^3.
  void assemble(const CellGradients& cells, const bool* counted, const std::vector<Roof>& roofs, const double* stiffness);

  // -K_ii u_i, N, of one body. A displacement u, m, has 0 in its last component; that of a force means nothing.
  Four own(std::size_t body, const Four& displacement) const {
    const double* const from = &own_[9 * body];
    return load(from) * displacement[0] + load(from + 3) * displacement[1] + load(from + 6) * displacement[2];
  }

  // Adds -K_ij u_j of all pairs of different bodies to force (bodies), N. displacement (bodies).
  void add_mutual(const Four* displacement, Four* force) const;

 private:
  static constexpr int edges = 4;

  // -K_ji by columns of one body i with four others j: what i's displacement along x, y and z has j pushed by. Of 0 where there is no other.
  struct alignas(64) Pack {
    std::array<std::array<double, 9>, edges> block{};
    double after = 0.0;  // is loaded along with the last column
    std::array<std::int32_t, edges> other;
    std::int32_t body;
  };

  std::vector<Pack, HugePages<Pack>> pack_;
  std::vector<double> own_;          // (bodies, 9), and one more: -K_ii by columns
  std::vector<std::int32_t> place_;  // of the pairs of members k < l of all cells: edges * pack + edge, or ~ that where l is the pack's body
  std::int32_t wall_ = 0;
};

}  // namespace poreslip::geometry
