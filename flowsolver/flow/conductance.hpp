// Conductance over length of each throat that this rank owns.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "network/pore_network.hpp"

namespace poreslip::flow {

enum class ConductanceLaw {
  duct,              // (6): 3 A^3 / (5 viscosity P^2)
  hydraulic_radius,  // A R_h^2 / (2 viscosity), R_h = void / solid surface of the throat's own sub-volume (Chareyre et al. 2012)
};

struct Fluid {
  double viscosity;        // Pa s
  double compressibility;  // 1/Pa
};

struct Limiter {
  double least_open_share;  // an open area counts as at least this share of its facet
  double least_void_share;  // for storage, a void counts as at least this share of its cell
};

// Arrays over all facets of the mesh.
struct Throats {
  std::unique_ptr<bool[]> owned;       // by this rank
  std::vector<double> conductance;     // C / l, m^3 / (Pa s); 0 where another rank owns it
  std::vector<double> head;            // of the body force: b . (centroid of the right cell - of the left), Pa; empty: none
  std::int64_t limited = 0;            // throats whose open area was raised, on this rank
  double head_of(std::size_t throat) const { return head.empty() ? 0.0 : head[throat]; }
};

// body_force: of the fluid, Pa/m, such as density times gravity.
Throats make_throats(PoreNetwork& network, const Fluid& fluid, ConductanceLaw law, const Limiter& limiter,
                     const double* body_force);

// beta * V of each local pore, m^3/Pa, with the limiter on V. limited: owned pores that it raised, on this rank.
std::vector<double> storage(PoreNetwork& network, const Fluid& fluid, const Limiter& limiter, std::int64_t& limited);

}  // namespace poreslip::flow
