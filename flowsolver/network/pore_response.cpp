#include "network/pore_response.hpp"

#include <algorithm>
#include <cmath>

#include "network/timer.hpp"
#include "tessellation/errors.hpp"

namespace poreslip {
namespace {

using geometry::ForceLaw;
using geometry::Four;

// Grains.
constexpr std::size_t ahead = 24;

}  // namespace

PoreResponse::~PoreResponse() = default;

void PoreResponse::begin(ForceLaw law, const double* pressure, const double* drift, const double* stiffness) {
  const std::size_t pores = network_.pores();
  start_.assign(pressure, pressure + pores);
  drift_.assign(drift, drift + pores);
  stiffness_.assign(stiffness, stiffness + pores);
  swept_.assign(pores, 0.0);
  swept_known_ = true;
  elapsed_ = 0.0;
  work_ = {};
  directory_ = network_.directory();
  id_.clear();
  if (!gradients_.take(law)) connected_ = false;
  by_matrix_ = law == ForceLaw::total;
  take_order(directory_.input_size(), nullptr);
  way_.assign(network_.local_grains().size() + 1, Four{});
  wall_before_.assign(6 * network_.groups(), 0.0);
  gained_.resize(pores);
  if (by_matrix_) begin_by_matrix();
  force_.assign(way_.size(), Four{});
  sum_roofs(start_, wall_before_.data());
  begun_ = true;
}

void PoreResponse::begin_by_matrix() {
  const LocalGrains& local = network_.local_grains();
  const std::size_t grains = local.size(), entries = wall_before_.size();
  displacement_.assign(grains + 1 + entries, Four{});
  way_ = displacement_;
  drifted_ = 0.0;
  int rank = 0;
  MPI_Comm_rank(network_.communicator(), &rank);
  // What a rank knows of all at once, without what matrices of other ranks will add: forces on its own grains; on walls, once over all ranks.
  const auto forces_of = [&](const std::vector<double>& pressure, std::vector<Four>& force) {
    force.assign(displacement_.size(), Four{});
    gradients_.add_forces(pressure, force);
    for (std::size_t i = 0; i < grains; ++i)
      if (local.source[i] < 0) force[i] = Four{};
    std::vector<double> on_walls(entries);
    sum_roofs(pressure, on_walls.data());
    for (std::size_t e = 0; rank == 0 && e < entries; ++e) force[grains + 1 + e][0] = on_walls[e];
  };
  forces_of(start_, first_);
  forces_of(drift_, drifting_);
  if (!connected_) matrix_.connect(gradients_.cells(), network_.owned(), gradients_.roofs(), displacement_.size(), gradients_.at_rest());
  connected_ = true;
  matrix_.assemble(gradients_.cells(), network_.owned(), gradients_.roofs(), stiffness_.data());
}

void PoreResponse::take_order(std::size_t count, const std::int32_t* id) {
  if (id) {
    id_.assign(id, id + count);
    const std::vector<std::int64_t> wide(id, id + count);
    GrainInput input{};
    input.count = count;
    input.id = wide.data();
    if (directory_.match(network_.communicator(), input) == GrainDirectory::Match::other)
      throw ComputationError("the grains are not those that the pore network was made of: some were lost, as where steps are too "
                             "long for their contacts, or have come in between");
  }
  const LocalGrains& local = network_.local_grains();
  int ranks = 1;
  MPI_Comm_size(network_.communicator(), &ranks);
  // Without other ranks there are no strays, and images only where there are periods.
  alone_ = ranks == 1 && by_matrix_ && std::all_of(local.source.begin(), local.source.end(), [](std::int32_t s) { return s >= 0; });
  if (!alone_) return;
  std::vector<std::int32_t> input_of_own(count);
  for (std::size_t i = 0; i < count; ++i) input_of_own[directory_.own_of_input(i)] = static_cast<std::int32_t>(i);
  input_of_local_.resize(local.size());
  for (std::size_t i = 0; i < local.size(); ++i) input_of_local_[i] = input_of_own[local.source[i]];
}

// Ways of all local grains in a step from the velocities of the caller's.
void PoreResponse::spread(double dt, const double* velocity) {
  const LocalGrains& local = network_.local_grains();
  std::vector<std::array<double, 3>> own(network_.own_grains());
  directory_.gather_vectors(network_.communicator(), velocity, own);
  const auto halo = network_.halo().fetch(own);
  for (std::size_t i = 0; i < local.size(); ++i) {
    const std::int32_t s = local.source[i];
    const auto& v = s >= 0 ? own[s] : halo[-1 - s];
    way_[i] = Four{dt * v[0], dt * v[1], dt * v[2], 0.0};
  }
}

// Forces on the caller's grains from those on the local ones.
void PoreResponse::collect(double* out) const {
  const LocalGrains& local = network_.local_grains();
  std::vector<std::array<double, 3>> own(network_.own_grains()), of_others(by_matrix_ ? network_.halo().grains().size() : 0);
  for (std::size_t i = 0; i < local.size(); ++i) {
    const std::array<double, 3> force{force_[i][0], force_[i][1], force_[i][2]};
    const std::int32_t s = local.source[i];
    if (s >= 0) own[s] = force;
    else if (by_matrix_) of_others[-1 - s] = force;
  }
  if (by_matrix_) network_.halo().add_to_owners(of_others, own);
  directory_.scatter(network_.communicator(), own, out);
}

void PoreResponse::sum_roofs(const std::vector<double>& pressure, double* wall_force) const {
  std::fill_n(wall_force, wall_before_.size(), 0.0);
  const bool* const owned = network_.owned();
  for (const geometry::Roof& r : gradients_.roofs())
    if (owned[r.cell]) wall_force[entry(r)] += pressure[r.cell] * r.area;
  MPI_Allreduce(MPI_IN_PLACE, wall_force, static_cast<int>(wall_before_.size()), MPI_DOUBLE, MPI_SUM, network_.communicator());
}

const std::vector<double>& PoreResponse::swept() const {
  if (!swept_known_) {
    swept_ = gradients_.gained(displacement_);
    network_.exchange().fetch(swept_.data());
  }
  swept_known_ = true;
  return swept_;
}

std::vector<double> PoreResponse::pressure() const {
  swept();
  std::vector<double> now(start_.size());
  for (std::size_t c = 0; c < now.size(); ++c) now[c] = pressure_at(c);
  return now;
}

std::array<double, 3> PoreResponse::work() const {
  if (!by_matrix_) return work_;
  // The sum over all steps of the mean pressure in the step, start + middle * drift - stiffness * (mean of swept), times the volume gained. That
  // of drift is as if all had been gained in the interval's middle; what steps before and after it differ by the forces have summed up.
  const std::vector<double> volume = gradients_.gained(displacement_);
  const double middle = 0.5 * elapsed_;
  double by_fluid = drifted_;
  for (std::size_t c = 0; c < volume.size(); ++c)
    if (network_.owned()[c]) by_fluid += (start_[c] + middle * drift_[c] - 0.5 * stiffness_[c] * volume[c]) * volume[c];
  Four in_middle{};
  for (std::size_t i = 0; i < drifting_.size(); ++i) in_middle += drifting_[i] * displacement_[i];
  return {work_[0], by_fluid - middle * (in_middle[0] + in_middle[1] + in_middle[2]), work_[2]};
}

void PoreResponse::forces(double* force, double* wall_force) const {
  if (by_matrix_) {
    for (std::size_t i = 0; i < force_.size(); ++i) force_[i] = apart(i);
    add_mutual(wall_force);
  } else {
    const std::vector<double> now = pressure();
    std::fill(force_.begin(), force_.end(), Four{});
    gradients_.add_forces(now, force_);
    sum_roofs(now, wall_force);
  }
  collect(force);
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
  if (by_matrix_) {
    move(dt, velocity, wall_velocity);
    add_mutual(wall_force);
  } else {
    spread(dt, velocity);
    std::fill(force_.begin(), force_.end(), Four{});
    elapsed_ += dt;
    work_[1] += answer_by_cells(dt, wall_velocity);
    sum_roofs(pressure(), wall_force);
  }
  if (alone_) {
    work_alone(force);
  } else {
    before_.assign(force, force + 3 * count);
    collect(force);
    add_work(dt, 3 * count, before_.data(), force, velocity);
  }
  // The walls are every rank's: one counts them.
  int rank = 0;
  MPI_Comm_rank(network_.communicator(), &rank);
  if (rank == 0) add_work(dt, wall_before_.size(), wall_before_.data(), wall_force, wall_velocity);
  std::copy_n(wall_force, wall_before_.size(), wall_before_.begin());
}

// Velocity Verlet gives the grains the mean of the forces at both ends of the step.
void PoreResponse::add_work(double dt, std::size_t size, const double* before, const double* after, const double* speed) {
  for (std::size_t k = 0; k < size; ++k) {
    const double work = 0.5 * (before[k] + after[k]) * dt * speed[k];
    work_[0] += work;
    work_[2] += std::abs(work);
  }
}

// Moves the local grains and the walls' entries, and sets the forces on them but for those of the others' displacements.
void PoreResponse::move(double dt, const double* velocity, const double* wall_velocity) {
  const std::size_t grains = network_.local_grains().size();
  const double middle = elapsed_ + 0.5 * dt;
  elapsed_ += dt;
  swept_known_ = false;
  Four power{};
  const auto go = [&](std::size_t i, const Four& way) {
    way_[i] = way;
    displacement_[i] += way;
    power += drifting_[i] * way;
    force_[i] = apart(i);
  };
  if (alone_) {
    // The caller's order is none in space: each grain's entries are fetched well before they are needed.
    for (std::size_t i = 0; i < grains; ++i) {
      if (i + ahead < grains) __builtin_prefetch(velocity + entries_of(i + ahead));
      const double* const v = velocity + entries_of(i);
      go(i, dt * Four{v[0], v[1], v[2], 0.0});
    }
  } else {
    spread(dt, velocity);
    for (std::size_t i = 0; i < grains; ++i) go(i, way_[i]);
  }
  for (std::size_t e = 0; e < wall_before_.size(); ++e) go(grains + 1 + e, Four{dt * wall_velocity[e], 0.0, 0.0, 0.0});
  force_[grains] = Four{};
  drifted_ += middle * (power[0] + power[1] + power[2]);
}

// Adds to the forces what comes of the others' displacements. Then they are: on local grains, what this rank knows of them; on walls, over all ranks.
void PoreResponse::add_mutual(double* wall_force) const {
  matrix_.add_mutual(displacement_.data(), force_.data());
  const std::size_t walls = force_.size() - wall_before_.size();
  for (std::size_t e = 0; e < wall_before_.size(); ++e) wall_force[e] = force_[walls + e][0];
  if (!alone_)
    MPI_Allreduce(MPI_IN_PLACE, wall_force, static_cast<int>(wall_before_.size()), MPI_DOUBLE, MPI_SUM, network_.communicator());
}

// Hands over the forces on the grains, and adds their work.
void PoreResponse::work_alone(double* force) {
  const std::size_t grains = input_of_local_.size();
  Four sum{}, sizes{};
  for (std::size_t i = 0; i < grains; ++i) {
    if (i + ahead < grains) __builtin_prefetch(force + entries_of(i + ahead), 1);
    double* const f = force + entries_of(i);
    const Four work = 0.5 * (Four{f[0], f[1], f[2], 0.0} + force_[i]) * way_[i];
    sum += work;
    sizes += work < 0.0 ? -work : work;
    for (int d = 0; d < 3; ++d) f[d] = force_[i][d];
  }
  for (int d = 0; d < 3; ++d) {
    work_[0] += sum[d];
    work_[2] += sizes[d];
  }
}

double PoreResponse::answer_by_cells(double dt, const double* wall_velocity) {
  std::fill(gained_.begin(), gained_.end(), 0.0);
  for (const geometry::Roof& r : gradients_.roofs()) gained_[r.cell] += r.area * (dt * wall_velocity[entry(r)]);
  geometry::add_gained_volumes(gradients_.cells(), way_.data(), gained_.data());
  // Only the owner of a pore is sure to know all its facets.
  network_.exchange().fetch(gained_.data());
  double work = 0.0;
  for (std::size_t c = 0; c < gained_.size(); ++c) {
    swept_[c] += gained_[c];
    const double rise = dt * drift_[c] - stiffness_[c] * gained_[c];
    if (network_.owned()[c]) work += (pressure_at(c) - 0.5 * rise) * gained_[c];
  }
  gradients_.add_forces(pressure(), force_);
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
