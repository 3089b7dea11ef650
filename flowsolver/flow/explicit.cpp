// Explicit steps (9).
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "flow/pore_flow.hpp"
#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip::flow {
namespace {

double elapsed(double since) { return MPI_Wtime() - since; }

}  // namespace

SolveReport PoreFlow::step_explicit(const Conditions& conditions, double dt, double limit_share, std::int64_t most_substeps,
                                    double* pressure, double* flowing) {
  require_current();
  SolveReport report{};
  const double clock = MPI_Wtime();
  const Mesh& mesh = network_.mesh();
  const std::size_t n = network_.pores();
  number(conditions.fixed, true);
  std::copy_n(conditions.pressure, n, pressure);
  network_.exchange().fetch(pressure);
  report.unknowns = all_rows_;
  report.limited_pores = sum(comm_, limited_pores_);
  report.limited_throats = sum(comm_, throats_.limited);
  std::vector<double> total(n, 0.0), flow(n);
  for (std::size_t f = 0; f < throats_.conductance.size(); ++f) {
    total[mesh.facet.left[f]] += throats_.conductance[f];
    total[mesh.facet.right[f]] += throats_.conductance[f];
  }
  network_.exchange().add_to_owner(total.data());
  // (9) is stable up to the smallest beta V / sum(C / l); a free pore without storage has no limit at all.
  double rate = 0.0;
  for (const std::int32_t c : free_) rate = std::max(rate, total[c] / storage_[c]);
  MPI_Allreduce(MPI_IN_PLACE, &rate, 1, MPI_DOUBLE, MPI_MAX, comm_);
  const double steps = std::max(1.0, std::ceil(dt * rate / limit_share));
  std::string fault;
  if (!(steps <= static_cast<double>(most_substeps))) {
    char text[320];
    // Rounded down, for it to hold as it is printed.
    const double longest = 0.995 * static_cast<double>(most_substeps) * limit_share / rate;
    std::snprintf(text, sizeof text,
                  "explicit flow over %g s needs %.3g steps of at most %g s, more than the %lld allowed; use the implicit scheme, or "
                  "steps of at most %.3g s in all",
                  dt, steps, limit_share / rate, static_cast<long long>(most_substeps), longest);
    fault = text;
  }
  agree_on_input(comm_, fault);
  report.substeps = static_cast<std::int64_t>(steps);
  std::fill_n(flowing, n, 0.0);
  for (std::int64_t s = 0; s < report.substeps; ++s) {
    for (std::size_t c = 0; c < n; ++c) flowing[c] += pressure[c] / steps;
    outflow(pressure, flow.data());
    for (const std::int32_t c : free_)
      pressure[c] += dt / steps * (conditions.source[c] - conditions.volume_rate[c] - flow[c]) / storage_[c];
    network_.exchange().fetch(pressure);
  }
  report.solve = elapsed(clock);
  return report;
}

}  // namespace poreslip::flow
