#include "network/pore_response.hpp"

#include <algorithm>
#include <cmath>

#include "geometry/cells.hpp"
#include "network/timer.hpp"
#include "network/wall_steps.hpp"
#include "tessellation/errors.hpp"

namespace poreslip {
namespace {

using geometry::ForceLaw;
using geometry::Four;

using Gradients = std::vector<std::array<Four, 4>>;  // dV_c/dx of the four vertices of each cell; 0 for walls

void add_gradient(Gradients& gradients, const Mesh& mesh, std::size_t cell, Vertex grain, const Four& gradient) {
  int k = 0;
  while (mesh.cell_vertex[k][cell] != grain) ++k;
  gradients[cell][k] += gradient;
}

void add_facets(Gradients& gradients, const Mesh& mesh, const FacetView& facets, const GrainView& grains, ForceLaw law) {
  for (std::size_t f = 0; f < facets.size(); ++f) {
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

PoreResponse::~PoreResponse() = default;

void PoreResponse::begin(ForceLaw law, const double* pressure, const double* drift, const double* stiffness) {
  const std::size_t pores = network_.pores();
  start_.assign(pressure, pressure + pores);
  drift_.assign(drift, drift + pores);
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
  const LocalGrains& local = network_.local_grains();
  Gradients gradients(mesh.cells());
  add_facets(gradients, mesh, mesh.facet_view(), grains, ForceLaw::total);
  add_facets(gradients, mesh, mesh.outer.view(), grains, ForceLaw::total);
  if (network_.groups() > 1)
    for_each_step_gradient(mesh, grains, network_.wall_facets(), [&](std::size_t c, Vertex g, const Vector3& gradient) {
      add_gradient(gradients, mesh, c, g, Four{gradient[0], gradient[1], gradient[2], 0.0});
    });
  volume_.grain.resize(mesh.cells());
  volume_.gradient.resize(9 * mesh.cells() + 1);
  for (std::size_t c = 0; c < mesh.cells(); ++c) {
    if (!mesh.owned[c] && c < mesh.cell_end[0]) close(gradients[c], mesh, c, local);
    for (int k = 0; k < 4; ++k) {
      const Vertex v = mesh.cell_vertex[k][c];
      volume_.grain[c][k] = is_wall(v) ? static_cast<std::int32_t>(local.size()) : v;
      for (int d = 0; k < 3 && d < 3; ++d) volume_.gradient[9 * c + 3 * k + d] = gradients[c][k][d];
    }
  }
  push_.clear();
  if (law != ForceLaw::total) {
    push_.resize(mesh.cells());
    add_facets(push_, mesh, mesh.facet_view(), grains, law);
  }
  roof_.clear();
  geometry::for_each_roof(mesh.cell_view(), grains, [this](std::size_t cell, std::size_t entry, double area) {
    if (!roof_.empty() && roof_.back().cell == cell && roof_.back().entry == entry) roof_.back().area += area;
    else roof_.push_back({cell, entry, area});
  });
}

// Forces of the pressures on the local grains.
void PoreResponse::push() const {
  const std::vector<double> now = pressure();
  if (push_.empty()) {
    geometry::add_cell_forces(volume_, now.data(), 0, now.size(), force_.data());
    return;
  }
  for (std::size_t c = 0; c < now.size(); ++c)
    for (int k = 0; k < 4; ++k) force_[volume_.grain[c][k]] += now[c] * push_[c][k];
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
      displacement_[i] = Four{dt * v[0], dt * v[1], dt * v[2], 0.0};
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
    displacement_[i] = Four{dt * v[0], dt * v[1], dt * v[2], 0.0};
  }
}

// Forces on the caller's grains from those on the local ones.
void PoreResponse::collect(double* out) const {
  if (alone_) {
    for (std::size_t i = 0; i < input_of_local_.size(); ++i)
      for (int d = 0; d < 3; ++d) out[3 * static_cast<std::size_t>(input_of_local_[i]) + d] = force_[i][d];
    return;
  }
  const LocalGrains& local = network_.local_grains();
  std::vector<std::array<double, 3>> own(network_.own_grains());
  for (std::size_t i = 0; i < local.size(); ++i)
    if (const std::int32_t s = local.source[i]; s >= 0) own[s] = {force_[i][0], force_[i][1], force_[i][2]};
  directory_.scatter(network_.communicator(), own, out);
}

void PoreResponse::sum_roofs(double* wall_force) const {
  std::fill_n(wall_force, wall_before_.size(), 0.0);
  const bool* const owned = network_.owned();
  for (const Roof& r : roof_)
    if (owned[r.cell]) wall_force[r.entry] += pressures().at(r.cell, elapsed_) * r.area;
  MPI_Allreduce(MPI_IN_PLACE, wall_force, static_cast<int>(wall_before_.size()), MPI_DOUBLE, MPI_SUM, network_.communicator());
}

std::vector<double> PoreResponse::pressure() const {
  std::vector<double> now(start_.size());
  for (std::size_t c = 0; c < now.size(); ++c) now[c] = pressures().at(c, elapsed_);
  return now;
}

void PoreResponse::forces(double* force, double* wall_force) const {
  std::fill(force_.begin(), force_.end(), Four{});
  push();
  collect(force);
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
  elapsed_ += dt;
  work_[1] += alone_ && push_.empty() ? answer_alone(dt, wall_velocity) : answer_shared(dt, wall_velocity);

  before_.assign(force, force + 3 * count);
  collect(force);
  sum_roofs(wall_force);
  // Velocity Verlet gives the grains the mean of the forces at both ends of the step.
  const auto add_work = [this, dt](const double* before, const double* after, const double* speed, std::size_t size) {
    double sum = 0.0, sizes = 0.0;
    for (std::size_t k = 0; k < size; ++k) {
      const double work = 0.5 * (before[k] + after[k]) * dt * speed[k];
      sum += work;
      sizes += std::abs(work);
    }
    work_[0] += sum;
    work_[2] += sizes;
  };
  add_work(before_.data(), force, velocity, 3 * count);
  // The walls are every rank's: one counts them.
  int rank = 0;
  MPI_Comm_rank(network_.communicator(), &rank);
  if (rank == 0) add_work(wall_before_.data(), wall_force, wall_velocity, wall_before_.size());
  std::copy_n(wall_force, wall_before_.size(), wall_before_.begin());
}

// Where this rank knows all of every pore, and forces are the gradients of the volumes: one pass.
double PoreResponse::answer_alone(double dt, const double* wall_velocity) {
  const std::size_t inner = network_.mesh().cell_end[0], pores = start_.size();
  // Cells without walls come first; those with walls also gain what the walls sweep.
  std::fill(gained_.begin() + inner, gained_.end(), 0.0);
  for (const Roof& r : roof_) gained_[r.cell] += r.area * (dt * wall_velocity[r.entry]);
  const auto answer = [this, dt](const double* by_walls, std::size_t first, std::size_t last) {
    return geometry::answer(volume_, displacement_.data(), by_walls, pressures(), elapsed_, dt, first, last, force_.data());
  };
  return answer(nullptr, 0, inner) + answer(gained_.data() + inner, inner, pores);
}

double PoreResponse::answer_shared(double dt, const double* wall_velocity) {
  std::fill(gained_.begin(), gained_.end(), 0.0);
  for (const Roof& r : roof_) gained_[r.cell] += r.area * (dt * wall_velocity[r.entry]);
  geometry::add_gained_volumes(volume_, displacement_.data(), 0, gained_.size(), gained_.data());
  // Only the owner of a pore is sure to know all its facets.
  network_.exchange().fetch(gained_.data());
  double work = 0.0;
  for (std::size_t c = 0; c < gained_.size(); ++c) {
    swept_[c] += gained_[c];
    const double rise = dt * drift_[c] - stiffness_[c] * gained_[c];
    if (network_.owned()[c]) work += (pressures().at(c, elapsed_) - 0.5 * rise) * gained_[c];
  }
  push();
  return work;
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
