#include "network/volume_gradients.hpp"

#include <algorithm>

#include "geometry/cells.hpp"
#include "network/wall_steps.hpp"

namespace poreslip {
namespace {

using geometry::ForceLaw;
using geometry::Four;

using Gradients = std::vector<std::array<Four, 4>>;

std::uint8_t corner_of(const Mesh& mesh, std::size_t cell, Vertex grain) {
  std::uint8_t k = 0;
  while (mesh.cell_vertex[k][cell] != grain) ++k;
  return k;
}

void add_gradient(Gradients& gradients, const Mesh& mesh, std::size_t cell, Vertex grain, const Four& gradient) {
  gradients[cell][corner_of(mesh, cell, grain)] += gradient;
}

// Of facets from the first one on.
void add_facets(Gradients& gradients, const Mesh& mesh, const FacetView& facets, const GrainView& grains, ForceLaw law, std::size_t first = 0) {
  for (std::size_t f = first; f < facets.size(); ++f) {
    const geometry::FacetShares s = geometry::facet_shares(facets, grains, f, law);
    const Four normal{s.normal[0], s.normal[1], s.normal[2], 0.0};
    const int count = f < facets.end[0] ? 3 : f < facets.end[1] ? 2 : 1;
    for (int k = 0; k < count; ++k) {
      const Four part = s.share[k] * normal;
      add_gradient(gradients, mesh, facets.left[f], facets.vertex[k][f], part);
      if (facets.right[f] >= 0) add_gradient(gradients, mesh, facets.right[f], facets.vertex[k][f], -part);
    }
  }
}

// A pore that this rank does not own may lack facets, and with them parts of the gradients of vertices that are not its own, whose
// forces and volumes are the owner's matter. Those are set so that all four sum to 0.
void close(std::array<Four, 4>& gradient, const Mesh& mesh, std::size_t cell, const LocalGrains& local) {
  for (int k = 0; k < 3; ++k) {
    const Vertex v = mesh.cell_vertex[k][cell];
    if (local.source[v] >= 0) continue;
    gradient[k] -= (gradient[0] + gradient[1]) + (gradient[2] + gradient[3]);
    return;
  }
}

}  // namespace

VolumeGradients::~VolumeGradients() = default;

bool VolumeGradients::take(ForceLaw law) {
  const Mesh& mesh = network_.mesh();
  const GrainView grains = network_.view();
  const LocalGrains& local = network_.local_grains();
  const FacetView facets = mesh.facet_view();
  const bool same_mesh = mesh_number_ == network_.mesh_number();
  if (!same_mesh) take_corners(facets);
  mesh_number_ = network_.mesh_number();
  Gradients gradients(mesh.cells());
  geometry::add_triangle_gradients(facets, grains, corner_.data(), &gradients.data()->front()[0]);
  add_facets(gradients, mesh, facets, grains, ForceLaw::total, facets.end[0]);
  add_facets(gradients, mesh, mesh.outer.view(), grains, ForceLaw::total);
  if (network_.groups() > 1)
    for_each_step_gradient(mesh, grains, network_.wall_facets(), [&](std::size_t c, Vertex g, const Vector3& gradient) {
      add_gradient(gradients, mesh, c, g, Four{gradient[0], gradient[1], gradient[2], 0.0});
    });
  cells_.grain.resize(mesh.cells());
  cells_.gradient.resize(9 * mesh.cells() + 1);
  for (std::size_t c = 0; c < mesh.cells(); ++c) {
    if (!mesh.owned[c] && c < mesh.cell_end[0]) close(gradients[c], mesh, c, local);
    for (int k = 0; k < 4; ++k) {
      const Vertex v = mesh.cell_vertex[k][c];
      cells_.grain[c][k] = is_wall(v) ? at_rest() : v;
      for (int d = 0; k < 3 && d < 3; ++d) cells_.gradient[9 * c + 3 * k + d] = gradients[c][k][d];
    }
  }
  push_.clear();
  if (law != ForceLaw::total) {
    push_.resize(mesh.cells());
    add_facets(push_, mesh, facets, grains, law);
  }
  const bool same_roofs = take_roofs();
  return same_mesh && same_roofs;
}

// Which vertices of their cells the grains of triangles are: the same until the mesh changes.
void VolumeGradients::take_corners(const FacetView& facets) {
  const Mesh& mesh = network_.mesh();
  corner_.resize(facets.end[0]);
  for (std::size_t f = 0; f < corner_.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      corner_[f].left[k] = corner_of(mesh, facets.left[f], facets.vertex[k][f]);
      if (facets.right[f] >= 0) corner_[f].right[k] = corner_of(mesh, facets.right[f], facets.vertex[k][f]);
    }
}

// Whether they are of the same cells and walls as before: a grain may have come under another plane on the same mesh.
bool VolumeGradients::take_roofs() {
  const std::vector<geometry::Roof> before(std::move(roof_));
  roof_.clear();
  geometry::for_each_roof(network_.mesh().cell_view(), network_.view(), [&](std::size_t cell, std::size_t entry, double area) {
    const auto body = static_cast<std::int32_t>(at_rest() + 1 + entry);
    if (!roof_.empty() && roof_.back().cell == cell && roof_.back().body == body) roof_.back().area += area;
    else roof_.push_back({cell, body, area});
  });
  const auto alike = [](const geometry::Roof& a, const geometry::Roof& b) { return a.cell == b.cell && a.body == b.body; };
  return std::equal(roof_.begin(), roof_.end(), before.begin(), before.end(), alike);
}

void VolumeGradients::add_forces(const std::vector<double>& pressure, std::vector<Four>& force) const {
  if (push_.empty()) {
    geometry::add_cell_forces(cells_, pressure.data(), force.data());
    return;
  }
  for (std::size_t c = 0; c < pressure.size(); ++c)
    for (int k = 0; k < 4; ++k) force[cells_.grain[c][k]] += pressure[c] * push_[c][k];
}

std::vector<double> VolumeGradients::gained(const std::vector<Four>& displacement) const {
  std::vector<double> volume(cells_.grain.size(), 0.0);
  geometry::add_gained_volumes(cells_, displacement.data(), volume.data());
  for (const geometry::Roof& r : roof_) volume[r.cell] += r.area * displacement[r.body][0];
  return volume;
}

}  // namespace poreslip
