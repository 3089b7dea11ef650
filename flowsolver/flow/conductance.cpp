#include "flow/conductance.hpp"

#include <algorithm>

#include "flow/hydraulic_radius.hpp"
#include "geometry/cells.hpp"

namespace poreslip::flow {

Throats make_throats(PoreNetwork& network, const Fluid& fluid, ConductanceLaw law, const Limiter& limiter,
                     const double* body_force) {
  const Mesh& mesh = network.mesh();
  const std::size_t n = mesh.facets();
  Throats t;
  t.owned = std::make_unique_for_overwrite<bool[]>(n);
  network.owned_throats(t.owned.get());
  t.conductance.resize(n);
  network.for_each_throat_block([&](const geometry::ThroatBlock& block) {
    if (law == ConductanceLaw::duct) {
      t.limited += geometry::duct_conductances(block, fluid.viscosity, limiter.least_open_share, &t.owned[block.first], &t.conductance[block.first]);
      return;
    }
    for (std::size_t k = 0; k < block.count; ++k) {
      const std::size_t f = block.first + k;
      if (!t.owned[f]) continue;
      const double least = limiter.least_open_share * block.facet_area[k];
      bool limited = block.open_area[k] < least;
      const double area = std::max({block.open_area[k], least, 0.0});
      const ThroatBody body = throat_body(mesh, network.view(), f);
      limited = limited || body.limited;
      t.limited += limited;
      if (area > 0.0 && body.radius > 0.0 && body.length > 0.0)
        t.conductance[f] = area * body.radius * body.radius / (2.0 * fluid.viscosity * body.length);
    }
  });
  if (body_force[0] == 0.0 && body_force[1] == 0.0 && body_force[2] == 0.0) return t;
  std::vector<double> centre(3 * mesh.cells());
  network.unwrapped_centre(centre.data());
  t.head.resize(n);
  for (std::size_t f = 0; f < n; ++f) {
    const double *p = &centre[3 * mesh.facet.left[f]], *q = &centre[3 * mesh.facet.right[f]];
    t.head[f] = body_force[0] * (q[0] - p[0]) + body_force[1] * (q[1] - p[1]) + body_force[2] * (q[2] - p[2]);
  }
  return t;
}

std::vector<double> storage(PoreNetwork& network, const Fluid& fluid, const Limiter& limiter, std::int64_t& limited) {
  const PoreVolumes& volume = network.volumes();
  std::vector<double> storage(network.pores());
  limited = 0;
  for (std::size_t c = 0; c < storage.size(); ++c) {
    const double least = limiter.least_void_share * volume.cell[c];
    limited += network.owned()[c] && volume.pore[c] < least;
    storage[c] = fluid.compressibility * std::max(volume.pore[c], least);
  }
  return storage;
}

}  // namespace poreslip::flow
