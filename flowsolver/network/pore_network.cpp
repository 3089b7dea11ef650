#include "network/pore_network.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "geometry/cells.hpp"
#include "network/copies_agree.hpp"
#include "network/timer.hpp"
#include "network/validation.hpp"
#include "network/wall_steps.hpp"
#include "tessellation/agreement.hpp"
#include "tessellation/certificate.hpp"
#include "tessellation/errors.hpp"
#include "tessellation/flips.hpp"
#include "tessellation/hilbert.hpp"
#include "tessellation/triangulation.hpp"

namespace poreslip {
namespace {

// The halo starts at three of the largest grain's diameters. Two do inside a dense pack, but next to walls, where it is loose, a
// pore can need more, and a halo that has to grow costs a second triangulation.
constexpr double halo_radii = 6.0;

// Beyond this share of violated facets, flips cost more than a new triangulation.
constexpr std::int64_t repair_one_in = 20;

// Whether no value is infinite or not a number: those have all bits of the exponent set.
bool all_finite(const double* value, std::size_t count) {
  constexpr std::uint64_t exponent = std::uint64_t{0x7ff} << 52;
  std::uint64_t bad = 0;
  for (std::size_t k = 0; k < count; ++k) {
    std::uint64_t bits;
    std::memcpy(&bits, value + k, sizeof bits);
    bad |= (bits & exponent) == exponent;
  }
  return bad == 0;
}

// A grain this share of a period outside the box is put back in; nearer ones stay where the DEM engine has them.
constexpr double wrap_margin = 0.25;

}  // namespace

PoreNetwork::PoreNetwork(MPI_Comm comm, const Domain& domain, double trusted_displacement)
    : domain_(domain), trusted_displacement_(trusted_displacement) {
  MPI_Comm_dup(comm, &comm_);
  agree_on_input(comm_, check_domain(domain));
  for (int d = 0; d < 3; ++d) {
    // Periodic coordinates are rounded to a grid on which shifts by a period are exact: all images then see the same
    // triangulation, ties included. The grid is 2^-50 of the box.
    const double largest = std::max({std::abs(domain.lower[d]), std::abs(domain.upper[d]), domain.length(d)});
    quantum_[d] = std::ldexp(1.0, std::ilogb(largest) + 3 - 52);
    period_[d] = std::round(domain.length(d) / quantum_[d]) * quantum_[d];
  }
}

PoreNetwork::~PoreNetwork() {
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (!finalized) MPI_Comm_free(&comm_);
}

void PoreNetwork::agree(const std::string& message) const { agree_on_input(comm_, message); }

GrainView PoreNetwork::view() const {
  return {local_.x.data(), local_.y.data(), local_.z.data(), local_.radius.data(), local_.packed.data(), local_.group.data(),
          wall_position_.data()};
}

Outcome PoreNetwork::update(const GrainInput& input, bool rebuild_asked) {
  std::string fault = check_grains(input, domain_);
  // One set of planes for all ranks: rank 0's.
  std::uint64_t groups = input.groups;
  MPI_Bcast(&groups, 1, MPI_UINT64_T, 0, comm_);
  std::vector<double> planes(6 * groups);
  if (groups == input.groups) std::copy_n(input.wall_position, 6 * groups, planes.begin());
  MPI_Bcast(planes.data(), static_cast<int>(planes.size()), MPI_DOUBLE, 0, comm_);
  bool same = groups == input.groups;
  for (std::size_t k = 0; same && k < planes.size(); ++k)
    same = planes[k] == input.wall_position[k] || !domain_.has_wall(static_cast<int>(k % 6));
  if (fault.empty() && !same) fault = "wall_position differs between ranks: every rank must give the same planes";
  agree_on_input(comm_, fault);

  const bool may_keep = meshed_ && !rebuild_asked && hidden_ == 0 && planes.size() == wall_position_.size();
  wall_position_ = std::move(planes);
  volumes_known_ = false;
  if (may_keep)
    if (const std::optional<Outcome> outcome = keep(input)) {
      ++(*outcome == Outcome::kept ? report_.kept : report_.repaired);
      return *outcome;
    }
  if (meshed_ && remember_previous_) leave_behind();
  rebuild(input);
  ++report_.rebuilt;
  return Outcome::rebuilt;
}

// A mesh that no longer is the triangulation still fills the box: its pores' volumes, with the grains where they now are, sum
// to those of the mesh to come.
void PoreNetwork::leave_behind() {
  const std::vector<double>& volume = volumes().pore;
  const std::size_t owned = std::count(mesh_.owned.get(), mesh_.owned.get() + pores(), true);
  previous_.grains.resize(4 * owned);
  previous_.volume.resize(owned);
  previous_.index.resize(owned);
  for (std::size_t c = 0, k = 0; c < pores(); ++c) {
    if (!mesh_.owned[c]) continue;
    for (int i = 0; i < 4; ++i) {
      const Vertex v = mesh_.cell_vertex[i][c];
      previous_.grains[4 * k + i] = is_wall(v) ? v : local_.id[v];
    }
    previous_.volume[k] = volume[c];
    previous_.index[k++] = static_cast<std::int32_t>(c);
  }
}

std::optional<Outcome> PoreNetwork::keep(const GrainInput& input) {
  const Timer timer(report_.certify);
  const GrainDirectory::Match match = directory_.match(comm_, input);
  if (match == GrainDirectory::Match::other) return std::nullopt;
  if (match == GrainDirectory::Match::scattered && !remember_previous_) return std::nullopt;
  place(input, true);
  halo_.refresh(own_);
  refresh_local_grains();
  if (match == GrainDirectory::Match::scattered) return std::nullopt;
  walls_ = make_wall_spheres(domain_, wall_position_);
  if (trusted_displacement_ > 0.0 && displacement_since_look() <= trusted_displacement_) return Outcome::kept;
  const Certificate certificate = certify(mesh_, local_, walls_);
  // What decides is the same on all ranks, of which some may have no grains.
  std::array<std::int64_t, 4> total{certificate.violated, certificate.inverted_cells, certificate.exact_tests,
                                    static_cast<std::int64_t>(mesh_.facets())};
  MPI_Allreduce(MPI_IN_PLACE, total.data(), 4, MPI_INT64_T, MPI_SUM, comm_);
  report_.exact_tests = total[2];
  look();
  if (total[0] == 0 && total[1] == 0) return Outcome::kept;
  if (total[1] > 0 || total[0] * repair_one_in > total[3]) return std::nullopt;
  const auto flips = flip(mesh_, local_, walls_, certificate);
  if (!copies_agree(comm_, flips.has_value(), flips.value_or(Flips{}), mesh_, local_, halo_)) return std::nullopt;
  if (remember_previous_) leave_behind();
  apply(*flips, local_, mesh_);
  mesh_changed();
  return Outcome::repaired;
}

// Keeps the places at which the mesh is known to hold.
void PoreNetwork::look() {
  if (trusted_displacement_ == 0.0) return;
  seen_ = own_;
  seen_walls_ = wall_position_;
}

// Largest displacement of a grain, or of a wall, since then, over all ranks.
double PoreNetwork::displacement_since_look() const {
  double square = 0.0, wall = 0.0;
  for (std::size_t i = 0; i < own_.size(); ++i) {
    const double x = own_.x[i] - seen_.x[i], y = own_.y[i] - seen_.y[i], z = own_.z[i] - seen_.z[i];
    square = std::max(square, x * x + y * y + z * z);
  }
  for (std::size_t k = 0; k < wall_position_.size(); ++k)
    if (domain_.has_wall(static_cast<int>(k % 6))) wall = std::max(wall, std::abs(wall_position_[k] - seen_walls_[k]));
  double largest = std::max(std::sqrt(square), wall);
  MPI_Allreduce(MPI_IN_PLACE, &largest, 1, MPI_DOUBLE, MPI_MAX, comm_);
  return largest;
}

// Own grains at their new places; continuous: as the periodic image nearest to where they were.
void PoreNetwork::place(const GrainInput& input, bool continuous) {
  OwnGrains before;
  if (continuous) before = own_;
  directory_.gather(comm_, input, own_);
  std::vector<double>* now[3] = {&own_.x, &own_.y, &own_.z};
  const std::vector<double>* then[3] = {&before.x, &before.y, &before.z};
  for (int d = 0; d < 3; ++d) {
    if (!domain_.periodic[d]) continue;
    for (std::size_t i = 0; i < own_.size(); ++i) {
      double x = (*now[d])[i];
      const double outside = std::max(domain_.lower[d] - x, x - domain_.upper[d]);
      if (continuous) x -= period_[d] * std::round((x - (*then[d])[i]) / period_[d]);
      else if (outside > wrap_margin * period_[d]) x -= period_[d] * std::floor((x - domain_.lower[d]) / period_[d]);
      (*now[d])[i] = std::round(x / quantum_[d]) * quantum_[d];
    }
  }
}

// Grains of which no mesh can be made leave a network without any: the mesh before is not of them.
void PoreNetwork::rebuild(const GrainInput& input) {
  meshed_ = false;
  try {
    mesh_anew(input);
  } catch (...) {
    own_ = {};
    halo_ = {};
    local_ = {};
    mesh_ = {};
    directory_.reset({});
    hidden_ = 0;
    mesh_changed();
    throw;
  }
  meshed_ = true;
}

void PoreNetwork::mesh_anew(const GrainInput& input) {
  const Timer timer(report_.tessellate);
  own_.id.assign(input.id, input.id + input.count);
  for (auto* v : {&own_.x, &own_.y, &own_.z, &own_.radius}) v->resize(input.count);
  own_.group.resize(input.count);
  directory_.reset(own_.id);
  agree_on_input(comm_, check_unique_ids(comm_, own_.id));
  place(input, false);
  walls_ = make_wall_spheres(domain_, wall_position_);

  double largest = 0.0;
  for (const double r : own_.radius) largest = std::max(largest, r);
  MPI_Allreduce(MPI_IN_PLACE, &largest, 1, MPI_DOUBLE, MPI_MAX, comm_);
  agree_on_input(comm_, largest > 0.0 ? "" : "there are no grains on any rank: a pore network needs at least one");

  // An empty sphere fits between the images of any grain, so a halo of two box diagonals always suffices.
  double diagonal = 0.0;
  for (int d = 0; d < 3; ++d) diagonal += domain_.length(d) * domain_.length(d);
  const double widest = 4.0 * (std::sqrt(diagonal) + largest);
  LocalCells cells;
  for (halo_width_ = halo_radii * largest;; halo_width_ *= 2.0) {
    halo_.build(comm_, domain_, period_, own_, halo_width_);
    sort_local_grains();
    cells = {};
    if (own_.size() > 0) cells = triangulate(local_, walls_, halo_.known_lower(), halo_.known_upper(), largest);
    agree_on_input(comm_, cells.coincident);
    if (!any_rank(comm_, !cells.complete)) break;
    if (halo_width_ > widest)
      throw ComputationError("the triangulation of the grains did not close within a halo of " +
                             std::to_string(halo_width_) + " m; check the positions and the box");
  }
  hidden_ = cells.hidden;
  MPI_Allreduce(MPI_IN_PLACE, &hidden_, 1, MPI_INT64_T, MPI_SUM, comm_);
  mesh_ = make_mesh(cells, local_);
  mesh_changed();
  look();
}

void PoreNetwork::mesh_changed() {
  wall_facets_ = facets_at_walls(mesh_);
  exchange_built_ = volumes_known_ = false;
  ++mesh_number_;
}

// Own grains and halo together, along a Hilbert curve; the order depends on positions and ids only, not on the caller's order.
void PoreNetwork::sort_local_grains() {
  const auto& halo = halo_.grains();
  const std::size_t own = own_.size(), n = own + halo.size();
  struct Key {
    std::uint64_t curve;
    std::int64_t id;
    std::array<std::int8_t, 3> shift;
    std::int32_t source;
    auto operator<=>(const Key&) const = default;
  };
  std::vector<Key> keys(n);
  double lower[3], scale = 0.0;
  for (int d = 0; d < 3; ++d) {
    lower[d] = domain_.lower[d] - (domain_.periodic[d] ? 2.0 * halo_width_ + domain_.length(d) : 0.0);
    scale = std::max(scale, domain_.upper[d] - lower[d] + (domain_.periodic[d] ? 2.0 * halo_width_ + domain_.length(d) : 0.0));
  }
  // The planes of groups may lie outside the box that was given first: the curve's cube is widened, and its ends are shared.
  scale *= 1.25;
  const auto curve = [&](double x, double y, double z) {
    const double p[3] = {x, y, z};
    std::array<std::uint32_t, 3> cell;
    for (int d = 0; d < 3; ++d) {
      const double s = (p[d] - lower[d]) / scale + 0.1;
      cell[d] = static_cast<std::uint32_t>(std::min(std::max(s, 0.0), 1.0) * ((1u << 21) - 1));
    }
    return hilbert_index(cell);
  };
  for (std::size_t i = 0; i < own; ++i)
    keys[i] = {curve(own_.x[i], own_.y[i], own_.z[i]), own_.id[i], {0, 0, 0}, static_cast<std::int32_t>(i)};
  for (std::size_t h = 0; h < halo.size(); ++h)
    keys[own + h] = {curve(halo[h].x, halo[h].y, halo[h].z), halo[h].id, halo[h].shift, -1 - static_cast<std::int32_t>(h)};
  std::sort(keys.begin(), keys.end());
  for (auto* v : {&local_.x, &local_.y, &local_.z, &local_.radius}) v->resize(n);
  local_.packed.resize(n);
  local_.id.resize(n);
  local_.group.resize(n);
  local_.source.resize(n);
  local_.shift.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    local_.id[i] = keys[i].id;
    local_.source[i] = keys[i].source;
    local_.shift[i] = keys[i].shift;
  }
  refresh_local_grains();
}

void PoreNetwork::refresh_local_grains() {
  const auto& halo = halo_.grains();
  for (std::size_t i = 0; i < local_.size(); ++i) {
    const std::int32_t s = local_.source[i];
    if (s >= 0) {
      local_.x[i] = own_.x[s];
      local_.y[i] = own_.y[s];
      local_.z[i] = own_.z[s];
      local_.radius[i] = own_.radius[s];
      local_.group[i] = own_.group[s];
    } else {
      const HaloGrain& h = halo[-1 - s];
      local_.x[i] = h.x;
      local_.y[i] = h.y;
      local_.z[i] = h.z;
      local_.radius[i] = h.radius;
      local_.group[i] = h.group;
    }
    local_.packed[i] = {local_.x[i], local_.y[i], local_.z[i], local_.radius[i]};
  }
}

void PoreNetwork::forces(const double* pressure, geometry::ForceLaw law, double* force, double* wall_force) {
  const Timer timer(report_.forces);
  std::string fault;
  if (!all_finite(pressure, pores())) {
    const std::size_t bad = std::find_if(pressure, pressure + pores(), [](double p) { return !std::isfinite(p); }) - pressure;
    char text[120];
    std::snprintf(text, sizeof text, "the pressure of pore %zu is %g Pa: pressures must be finite", bad, pressure[bad]);
    fault = text;
  }
  agree_on_input(comm_, fault);

  // Kept between calls: new memory costs more than half of the forces themselves.
  std::vector<geometry::Four>& local = local_force_;
  local.assign(local_.size(), geometry::Four{});
  geometry::add_facet_forces(mesh_.facet_view(), view(), pressure, law, local.data());
  if (law == geometry::ForceLaw::total && groups() > 1)
    for_each_step_gradient(mesh_, view(), wall_facets_, [&](std::size_t c, Vertex g, const Vector3& gradient) {
      local[g] += pressure[c] * geometry::Four{gradient[0], gradient[1], gradient[2], 0.0};
    });
  std::vector<std::array<double, 3>> own(own_.size());
  for (std::size_t i = 0; i < local_.size(); ++i)
    if (const std::int32_t s = local_.source[i]; s >= 0) own[s] = {local[i][0], local[i][1], local[i][2]};
  directory_.scatter(comm_, own, force);

  std::fill_n(wall_force, wall_position_.size(), 0.0);
  geometry::add_wall_forces(mesh_.cell_view(), view(), mesh_.owned.get(), pressure, wall_force);
  MPI_Allreduce(MPI_IN_PLACE, wall_force, static_cast<int>(wall_position_.size()), MPI_DOUBLE, MPI_SUM, comm_);
}

void PoreNetwork::wall_forces_of_gradient(const double* gradient, double* wall_force) {
  const Timer timer(report_.forces);
  std::vector<double> centre(3 * pores());
  geometry::cell_centroids(mesh_.cell_view(), view(), centre.data());
  std::fill_n(wall_force, wall_position_.size(), 0.0);
  geometry::add_wall_forces_of_gradient(mesh_.cell_view(), view(), mesh_.owned.get(), centre.data(), {gradient[0], gradient[1], gradient[2]},
                                        wall_force);
  MPI_Allreduce(MPI_IN_PLACE, wall_force, static_cast<int>(wall_position_.size()), MPI_DOUBLE, MPI_SUM, comm_);
}

void PoreNetwork::volume_rate(const double* velocity, const double* wall_velocity, double* rate) {
  const Timer timer(report_.forces);
  std::vector<std::array<double, 3>> own(own_.size());
  directory_.gather_vectors(comm_, velocity, own);
  const std::vector<std::array<double, 3>> halo = halo_.fetch(own);
  std::vector<double> vx(local_.size()), vy(local_.size()), vz(local_.size());
  for (std::size_t i = 0; i < local_.size(); ++i) {
    const std::int32_t s = local_.source[i];
    const auto& v = s >= 0 ? own[s] : halo[-1 - s];
    vx[i] = v[0];
    vy[i] = v[1];
    vz[i] = v[2];
  }
  std::fill_n(rate, pores(), 0.0);
  geometry::add_volume_rates(mesh_.facet.view(), view(), vx.data(), vy.data(), vz.data(), rate);
  geometry::add_volume_rates(mesh_.outer.view(), view(), vx.data(), vy.data(), vz.data(), rate);
  if (groups() > 1)
    for_each_step_gradient(mesh_, view(), wall_facets_, [&](std::size_t c, Vertex g, const Vector3& gradient) {
      rate[c] += gradient[0] * vx[g] + gradient[1] * vy[g] + gradient[2] * vz[g];
    });
  geometry::add_wall_volume_rates(mesh_.cell_view(), view(), wall_velocity, rate);
  // Only the owner of a pore is sure to know all its facets.
  exchange().fetch(rate);
}

const PoreExchange& PoreNetwork::exchange() {
  if (!exchange_built_) exchange_.build(comm_, mesh_, local_, halo_);
  exchange_built_ = true;
  return exchange_;
}

}  // namespace poreslip
