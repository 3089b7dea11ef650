// Void volumes of cells, (4)-(5).
#include <numbers>

#include "geometry/angle.hpp"
#include "geometry/cells.hpp"
#include "geometry/corners.hpp"
#include "geometry/walls.hpp"

namespace poreslip::geometry {
namespace {

// A vector as the kernels have it, and its length.
struct Edge {
  double x, y, z, square, length;
};

using poreslip::dot;
inline double dot(const Edge& a, const Edge& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

template <class Corner>
inline Edge edge(const Corner& at, int from, int to, std::size_t c) {
  const double x = at.x[to][c] - at.x[from][c], y = at.y[to][c] - at.y[from][c], z = at.z[to][c] - at.z[from][c];
  const double square = x * x + y * y + z * z;
  return {x, y, z, square, std::sqrt(square)};
}

// Dihedral angles of a tetrahedron ijkl at its edges a = ij, b = ik, c = il, d = jk, e = jl, f = kl. A vertex l that is a wall, infinitely
// far, makes c, e and f its normal.
struct Dihedrals {
  double a, b, c, d, e, f, determinant;
};

inline Dihedrals dihedrals(const Edge& a, const Edge& b, const Edge& c, const Edge& d, const Edge& e, const Edge& f) {
  const double determinant = a.x * (b.y * c.z - b.z * c.y) + a.y * (b.z * c.x - b.x * c.z) + a.z * (b.x * c.y - b.y * c.x);
  const double ab = dot(a, b), ac = dot(a, c), bc = dot(b, c), ad = dot(a, d), ae = dot(a, e);
  const double de = dot(d, e), bf = dot(b, f), df = dot(d, f), bd = dot(b, d);
  // At an edge e between directions p and q: tangent |e| det / ((e.e)(p.q) - (e.p)(e.q)). In a cell that is inside out all are negative.
  return {angle(a.length * determinant, a.square * bc - ab * ac), angle(b.length * determinant, b.square * ac - ab * bc),
          angle(c.length * determinant, c.square * ab - ac * bc), angle(d.length * determinant, ad * de - d.square * ae),
          angle(e.length * determinant, ae * de - e.square * ad), angle(f.length * determinant, f.square * bd - bf * df), determinant};
}

// Of a sphere between three planes through its centre, by the angles between these (Girard: their sum less pi is the solid angle).
inline double sector(double radius, double angles, double pi) { return (angles - pi) * radius * radius * radius / 3.0; }

void tetrahedra(const CellView& cells, const GrainView& grains, double* cell, double* pore) {
  Corners<4> at;
  for (std::size_t first = 0; first < cells.end[0]; first += block_size) {
    const std::size_t count = std::min(block_size, cells.end[0] - first);
    at.fetch(cells.vertex, grains.packed, first, count);
    Corners<4>::ask(cells.vertex, grains.packed, first + count, std::min(first + count + block_size, cells.end[0]));
#pragma omp simd
    for (std::size_t n = 0; n < count; ++n) {
      const Edge a = edge(at, 0, 1, n), b = edge(at, 0, 2, n), c = edge(at, 0, 3, n), d = edge(at, 1, 2, n), e = edge(at, 1, 3, n),
                 f = edge(at, 2, 3, n);
      const Dihedrals v = dihedrals(a, b, c, d, e, f);
      const double pi = std::copysign(std::numbers::pi, v.determinant);
      const double ri = at.r[0][n], rj = at.r[1][n], rk = at.r[2][n], rl = at.r[3][n];
      const double sectors = sector(ri, v.a + v.b + v.c, pi) + sector(rj, v.a + v.d + v.e, pi) + sector(rk, v.b + v.d + v.f, pi) +
                             sector(rl, v.c + v.e + v.f, pi);
      // Reciprocals by threes from that of a product.
      const double per_abc = 1.0 / (a.length * b.length * c.length), per_def = 1.0 / (d.length * e.length * f.length);
      const double lenses = lens_moment(ri, rj, a.length, b.length * c.length * per_abc) * v.a +
                            lens_moment(ri, rk, b.length, a.length * c.length * per_abc) * v.b +
                            lens_moment(ri, rl, c.length, a.length * b.length * per_abc) * v.c +
                            lens_moment(rj, rk, d.length, e.length * f.length * per_def) * v.d +
                            lens_moment(rj, rl, e.length, d.length * f.length * per_def) * v.e +
                            lens_moment(rk, rl, f.length, d.length * e.length * per_def) * v.f;
      cell[first + n] = v.determinant / 6.0;
      pore[first + n] = v.determinant / 6.0 - (sectors - lenses);
    }
  }
}

void prisms(const CellView& cells, const GrainView& grains, double* cell, double* pore) {
  Corners<3> at;
  alignas(64) double normal[3][block_size], gap[3][block_size];
  for (std::size_t first = cells.end[0]; first < cells.end[1]; first += block_size) {
    const std::size_t count = std::min(block_size, cells.end[1] - first);
    at.fetch({cells.vertex[0], cells.vertex[1], cells.vertex[2]}, grains.packed, first, count);
    for (std::size_t n = 0; n < count; ++n) {
      const int wall = wall_of(cells.vertex[3][first + n]);
      for (int d = 0; d < 3; ++d) normal[d][n] = d == wall_axis(wall) ? wall_sign(wall) : 0.0;
      for (int k = 0; k < 3; ++k) gap[k][n] = grains.gap(cells.vertex[k][first + n], wall);
    }
#pragma omp simd
    for (std::size_t n = 0; n < count; ++n) {
      const Edge a = edge(at, 0, 1, n), b = edge(at, 0, 2, n), d = edge(at, 1, 2, n), up{normal[0][n], normal[1][n], normal[2][n], 1.0, 1.0};
      const Dihedrals v = dihedrals(a, b, up, d, up, up);
      const double pi = std::copysign(std::numbers::pi, v.determinant);
      const double ri = at.r[0][n], rj = at.r[1][n], rk = at.r[2][n], gi = gap[0][n], gj = gap[1][n], gk = gap[2][n];
      const double sectors = sector(ri, v.a + v.b + v.c, pi) + sector(rj, v.a + v.d + v.e, pi) + sector(rk, v.b + v.d + v.f, pi);
      const double lenses = lens_over_two_pi(ri, rj, a.length) * v.a + lens_over_two_pi(ri, rk, b.length) * v.b +
                            lens_over_two_pi(rj, rk, d.length) * v.d +
                            0.5 * (cap_over_pi(ri, gi) * v.c + cap_over_pi(rj, gj) * v.e + cap_over_pi(rk, gk) * v.f);
      cell[first + n] = v.determinant * (gi + gj + gk) / 6.0;
      pore[first + n] = cell[first + n] - (sectors - lenses);
    }
  }
}

// Solid angle at the apex of three directions (Van Oosterom & Strackee 1983), by its half's tangent.
double solid_angle(double determinant, double la, double lb, double lc, double ab, double bc, double ca) {
  return 2.0 * angle(determinant, la * lb * lc + ab * lc + bc * la + ca * lb);
}

// What the grains take of a cell that has walls, term by term, m^3.
double solid_in_wall_cell(const CellView& cells, const GrainView& grains, std::size_t c, int grain_count) {
  Vertex v[4];
  for (int k = 0; k < 4; ++k) v[k] = cells.vertex[k][c];
  double solid = 0.0;
  for (int k = 0; k < grain_count; ++k) {
    Vector3 d[3];
    int m = 0;
    for (int o = 0; o < 4; ++o)
      if (o != k) d[m++] = direction(grains, v[k], v[o]);
    const double determinant = std::abs(dot(d[0], cross(d[1], d[2])));
    const double apex = solid_angle(determinant, norm(d[0]), norm(d[1]), norm(d[2]), dot(d[0], d[1]), dot(d[1], d[2]), dot(d[2], d[0]));
    solid += apex * grains.radius[v[k]] * grains.radius[v[k]] * grains.radius[v[k]] / 3.0;
    for (int o = k + 1; o < 4; ++o) {
      const double lens = is_wall(v[o])
                              ? 0.5 * cap_over_pi(grains.radius[v[k]], grains.gap(v[k], wall_of(v[o])))
                              : lens_over_two_pi(grains.radius[v[k]], grains.radius[v[o]],
                                                 norm(direction(grains, v[k], v[o])));
      if (lens == 0.0) continue;
      const Vector3 edge = direction(grains, v[k], v[o]);
      int p = 0;
      while (p == k || p == o) ++p;
      int q = p + 1;
      while (q == k || q == o) ++q;
      const Vector3 s = cross(edge, direction(grains, v[k], v[p])), t = cross(edge, direction(grains, v[k], v[q]));
      solid -= lens * angle(norm(cross(s, t)), dot(s, t));
    }
  }
  return solid;
}

}  // namespace

void pore_volumes(const CellView& cells, const GrainView& grains, double* cell, double* pore) {
  tetrahedra(cells, grains, cell, pore);
  prisms(cells, grains, cell, pore);
  wall_cell_volumes(cells, grains, 2, cell);
  for (int walls = 2; walls < 4; ++walls)
    for (std::size_t c = cells.end[walls - 1]; c < cells.end[walls]; ++c)
      pore[c] = cell[c] - std::copysign(1.0, cell[c]) * solid_in_wall_cell(cells, grains, c, 4 - walls);
}

}  // namespace poreslip::geometry
