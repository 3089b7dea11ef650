#include "network/pore_response.hpp"

#include <algorithm>
#include <cmath>

#include "geometry/cells.hpp"
#include "network/timer.hpp"
#include "network/wall_steps.hpp"
#include "tessellation/errors.hpp"

namespace poreslip {
namespace {

using geometry::CellGradients;
using geometry::ForceLaw;
using geometry::Four;

// Empty gradients of all cells of a mesh; `past` stands for walls.
CellGradients no_gradients(const Mesh& mesh, std::int32_t past) {
  CellGradients cells;
  cells.grain.resize(mesh.cells());
  cells.gradient.assign(mesh.cells(), {});
  for (std::size_t c = 0; c < mesh.cells(); ++c)
    for (int k = 0; k < 4; ++k) cells.grain[c][k] = is_wall(mesh.cell_vertex[k][c]) ? past : mesh.cell_vertex[k][c];
  return cells;
}

void add_gradient(CellGradients& cells, std::size_t cell, Vertex grain, const Four& gradient) {
  const auto& of_cell = cells.grain[cell];
  const int k = of_cell[0] == grain ? 0 : of_cell[1] == grain ? 1 : of_cell[2] == grain ? 2 : 3;
  cells.gradient[cell][k] += gradient;
}

void add_facets(CellGradients& cells, const FacetView& facets, const GrainView& grains, ForceLaw law) {
  for (std::size_t f = 0; f < facets.size(); ++f) {
    const geometry::FacetShares s = geometry::facet_shares(facets, grains, f, law);
    const Four normal{s.normal[0], s.normal[1], s.normal[2], 0.0};
    const int count = f < facets.end[0] ? 3 : f < facets.end[1] ? 2 : 1;
    for (int k = 0; k < count; ++k) {
      const Four part = s.share[k] * normal;
      add_gradient(cells, facets.left[f], facets.vertex[k][f], part);
      if (facets.right[f] >= 0) add_gradient(cells, facets.right[f], facets.vertex[k][f], -part);
    }
  }
}

}  // namespace

void PoreResponse::begin(ForceLaw law, const double* pressure, const double* stiffness) {
  const std::size_t pores = network_.pores();
  pressure_.assign(pressure, pressure + pores);
  stiffness_.assign(stiffness, stiffness + pores);
  swept_.assign(pores, 0.0);
  gained_.resize(pores);
  elapsed_ = 0.0;
  work_ = {};
  directory_ = network_.directory();
  id_.clear();
  take_gradients(law);
  take_order(directory_.input_size(), nullptr);
  displacement_.assign(network_.local_grains().size() + 1, Four{});
  force_.resize(displacement_.size());
  wall_before_.assign(6 * network_.groups(), 0.0);
  sum_roofs(wall_before_.data());
  begun_ = true;
}

void PoreResponse::take_gradients(ForceLaw law) {
  const Mesh& mesh = network_.mesh();
  const GrainView grains = network_.view();
  const auto past = static_cast<std::int32_t>(network_.local_grains().size());
  volume_ = no_gradients(mesh, past);
  push_ = law == ForceLaw::total ? CellGradients{} : volume_;
  add_facets(volume_, mesh.facet_view(), grains, ForceLaw::total);
  add_facets(volume_, mesh.outer.view(), grains, ForceLaw::total);
  if (network_.groups() > 1)
    for_each_step_gradient(mesh, grains, network_.wall_facets(), [&](std::size_t c, Vertex g, const Vector3& gradient) {
      add_gradient(volume_, c, g, Four{gradient[0], gradient[1], gradient[2], 0.0});
    });
  if (law != ForceLaw::total) add_facets(push_, mesh.facet_view(), grains, law);
  roof_.clear();
  geometry::for_each_roof(mesh.cell_view(), grains, [this](std::size_t cell, std::size_t entry, double area) {
    roof_.push_back({cell, entry, area});
  });
}

void PoreResponse::take_order(std::size_t count, const std::int32_t* id) {
  if (id) {
    id_.assign(id, id + count);
    const std::vector<std::int64_t> wide(id, id + count);
    GrainInput input{};
    input.count = count;
    input.id = wide.data();
    if (directory_.match(network_.communicator(), input) == GrainDirectory::Match::other)
      throw ComputationError("the grains are not those that the pore network was made of: some were lost or have come in between");
  }
  const LocalGrains& local = network_.local_grains();
  bool own = true;
  for (std::size_t i = 0; i < local.size(); ++i) own = own && local.source[i] >= 0;
  for (std::size_t i = 0; i < count; ++i) own = own && directory_.own_of_input(i) >= 0;
  int alone = own;
  MPI_Allreduce(MPI_IN_PLACE, &alone, 1, MPI_INT, MPI_LAND, network_.communicator());
  alone_ = alone;
  if (!alone_) return;
  std::vector<std::int32_t> input_of_own(count);
  for (std::size_t i = 0; i < count; ++i) input_of_own[directory_.own_of_input(i)] = static_cast<std::int32_t>(i);
  input_of_local_.resize(local.size());
  for (std::size_t i = 0; i < local.size(); ++i) input_of_local_[i] = input_of_own[local.source[i]];
}

// Displacements of all local grains from those of the caller's.
void PoreResponse::spread(double dt, const double* velocity) {
  if (alone_) {
    for (std::size_t i = 0; i < input_of_local_.size(); ++i) {
      const double* v = velocity + 3 * static_cast<std::size_t>(input_of_local_[i]);
      displacement_[i] = dt * Four{v[0], v[1], v[2], 0.0};
    }
    return;
  }
  const LocalGrains& local = network_.local_grains();
  std::vector<std::array<double, 3>> own(network_.own_grains());
  directory_.gather_vectors(network_.communicator(), velocity, own);
  const auto halo = network_.halo().fetch(own);
  for (std::size_t i = 0; i < local.size(); ++i) {
    const std::int32_t s = local.source[i];
    const auto& v = s >= 0 ? own[s] : halo[-1 - s];
    displacement_[i] = dt * Four{v[0], v[1], v[2], 0.0};
  }
}

// Forces on the caller's grains from those on the local ones.
void PoreResponse::collect(std::vector<Four>& force, double* out) const {
  if (alone_) {
    for (std::size_t i = 0; i < input_of_local_.size(); ++i)
      for (int d = 0; d < 3; ++d) out[3 * static_cast<std::size_t>(input_of_local_[i]) + d] = force[i][d];
    return;
  }
  const LocalGrains& local = network_.local_grains();
  std::vector<std::array<double, 3>> own(network_.own_grains());
  for (std::size_t i = 0; i < local.size(); ++i)
    if (const std::int32_t s = local.source[i]; s >= 0) own[s] = {force[i][0], force[i][1], force[i][2]};
  directory_.scatter(network_.communicator(), own, out);
}

void PoreResponse::sum_roofs(double* wall_force) const {
  std::fill_n(wall_force, wall_before_.size(), 0.0);
  const bool* const owned = network_.owned();
  for (const Roof& r : roof_)
    if (owned[r.cell]) wall_force[r.entry] += pressure_[r.cell] * r.area;
  MPI_Allreduce(MPI_IN_PLACE, wall_force, static_cast<int>(wall_before_.size()), MPI_DOUBLE, MPI_SUM, network_.communicator());
}

void PoreResponse::forces(double* force, double* wall_force) const {
  std::fill(force_.begin(), force_.end(), Four{});
  geometry::add_cell_forces(push_.grain.empty() ? volume_ : push_, pressure_.data(), 0, pressure_.size(), force_.data());
  collect(force_, force);
  sum_roofs(wall_force);
}

void PoreResponse::step(double dt, std::size_t count, const std::int32_t* id, const double* velocity,
                        const double* wall_velocity, double* force, double* wall_force) {
  const Timer timer(seconds_);
  if (!begun_) throw ComputationError("the grains moved, and no interval of the flow had begun");
  if (id) {
    int same = count == id_.size() && std::equal(id, id + count, id_.begin());
    if (!alone_) MPI_Allreduce(MPI_IN_PLACE, &same, 1, MPI_INT, MPI_LAND, network_.communicator());
    if (!same) take_order(count, id);
  }
  spread(dt, velocity);
  std::fill(force_.begin(), force_.end(), Four{});
  // Cells without walls come first; those with walls also gain what the walls sweep.
  const std::size_t inner = network_.mesh().cell_end[0], pores = pressure_.size();
  double by_fluid = 0.0;
  std::size_t first = 0;
  if (alone_ && push_.grain.empty()) {
    by_fluid = geometry::answer(volume_, displacement_.data(), stiffness_.data(), 0, inner, pressure_.data(), swept_.data(), force_.data());
    first = inner;
  }
  std::fill(gained_.begin() + first, gained_.end(), 0.0);
  for (const Roof& r : roof_) gained_[r.cell] += r.area * (dt * wall_velocity[r.entry]);
  geometry::add_gained_volumes(volume_, displacement_.data(), first, pores, gained_.data());
  // Only the owner of a pore is sure to know all its facets.
  if (!alone_) network_.exchange().fetch(gained_.data());
  const bool* const owned = network_.owned();
  for (std::size_t c = first; c < pores; ++c) {
    const double before = pressure_[c];
    pressure_[c] -= stiffness_[c] * gained_[c];
    swept_[c] += gained_[c];
    if (owned[c]) by_fluid += 0.5 * (before + pressure_[c]) * gained_[c];
  }
  geometry::add_cell_forces(push_.grain.empty() ? volume_ : push_, pressure_.data(), first, pores, force_.data());

  // Velocity Verlet gives the grains the mean of the forces at both ends of the step.
  const auto add_work = [this, dt](const double* before, const double* after, const double* speed, std::size_t size, double share) {
    for (std::size_t k = 0; k < size; ++k) {
      const double work = share * 0.5 * (before[k] + after[k]) * dt * speed[k];
      work_[0] += work;
      work_[2] += std::abs(work);
    }
  };
  before_.assign(force, force + 3 * count);
  collect(force_, force);
  sum_roofs(wall_force);
  add_work(before_.data(), force, velocity, 3 * count, 1.0);
  // The walls are every rank's: one counts them.
  int rank = 0;
  MPI_Comm_rank(network_.communicator(), &rank);
  add_work(wall_before_.data(), wall_force, wall_velocity, wall_before_.size(), rank == 0 ? 1.0 : 0.0);
  std::copy_n(wall_force, wall_before_.size(), wall_before_.begin());
  work_[1] += by_fluid;
  elapsed_ += dt;
}

const char* PoreResponse::step_for_engine(void* response, double dt, int count, const int* id, const double* velocity,
                                          const double* wall_velocity, double* force, double* wall_force) {
  auto* self = static_cast<PoreResponse*>(response);
  try {
    self->step(dt, static_cast<std::size_t>(count), id, velocity, wall_velocity, force, wall_force);
    return nullptr;
  } catch (const std::exception& error) {
    self->message_ = error.what();
    return self->message_.c_str();
  }
}

}  // namespace poreslip
