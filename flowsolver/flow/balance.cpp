// What flows at given pressures, pore by pore (8), and whether (7) holds.
#include <algorithm>
#include <cmath>

#include "flow/pore_flow.hpp"

namespace poreslip::flow {

void PoreFlow::outflow(const double* pressure, double* flow) {
  require_current();
  const Mesh& mesh = network_.mesh();
  std::fill_n(flow, network_.pores(), 0.0);
  for (std::size_t f = 0; f < throats_.conductance.size(); ++f) {
    const std::int32_t left = mesh.facet.left[f], right = mesh.facet.right[f];
    const double q = throats_.conductance[f] * (pressure[left] - pressure[right] + throats_.head_of(f));
    flow[left] += q;
    flow[right] -= q;
  }
  network_.exchange().add_to_owner(flow);
  network_.exchange().fetch(flow);
}

Balance PoreFlow::balance(const Conditions& conditions, const double* pressure, const double* change, double* supply) {
  outflow(pressure, supply);
  double sums[3] = {0.0, 0.0, 0.0};
  for (std::size_t c = 0; c < network_.pores(); ++c) {
    const double stored = change ? storage_[c] * change[c] : 0.0;
    supply[c] += conditions.volume_rate[c] - conditions.source[c] + stored;
    if (!network_.owned()[c]) continue;
    sums[2] += std::abs(conditions.source[c]) + std::abs(conditions.volume_rate[c]) + std::abs(stored);
    if (conditions.fixed[c]) {
      sums[2] += std::abs(supply[c]);
    } else {
      sums[0] += supply[c];
      sums[1] += std::abs(supply[c]);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, sums, 3, MPI_DOUBLE, MPI_SUM, comm_);
  return {std::abs(sums[0]), sums[1], sums[2]};
}

Driven PoreFlow::driven(const double* pressure, const double* change) const {
  require_current();
  const Mesh& mesh = network_.mesh();
  double sums[2] = {0.0, 0.0};
  for (std::size_t f = 0; f < throats_.conductance.size(); ++f) {
    const double left = pressure[mesh.facet.left[f]], right = pressure[mesh.facet.right[f]], head = std::abs(throats_.head_of(f));
    sums[0] += throats_.conductance[f] * (std::abs(left - right) + head);
    sums[1] += throats_.conductance[f] * (std::abs(left) + std::abs(right) + head);
  }
  if (change)
    for (std::size_t c = 0; c < network_.pores(); ++c)
      if (network_.owned()[c]) sums[1] += storage_[c] * std::abs(change[c]);
  MPI_Allreduce(MPI_IN_PLACE, sums, 2, MPI_DOUBLE, MPI_SUM, comm_);
  return {sums[0], sums[1]};
}

}  // namespace poreslip::flow
