// The pore network of a moving grain pack: its mesh, kept while it is valid, and what is asked of it.
#pragma once

#include <mpi.h>

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "geometry/facets.hpp"
#include "geometry/throats.hpp"
#include "network/grain_directory.hpp"
#include "network/grain_input.hpp"
#include "network/pore_exchange.hpp"
#include "tessellation/domain.hpp"
#include "tessellation/halo.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

enum class Outcome { kept, repaired, rebuilt };

struct NetworkReport {
  std::int64_t grains, pores, throats;       // over all ranks
  std::int64_t hidden_grains;                // inside others, without a cell, over all ranks
  std::int64_t kept, repaired, rebuilt;      // updates
  std::int64_t exact_tests;                  // of the last certificate, over all ranks
  double halo;                               // m
  double tessellate, certify, geometry, forces;  // seconds of this rank
};

struct ThroatSections {
  explicit ThroatSections(std::size_t throats) : facet_area(throats), open_area(throats), perimeter(throats), length(throats) {}
  std::vector<double> facet_area, open_area, perimeter, length;  // m^2, m^2, m, m
};

struct PoreVolumes {
  std::vector<double> cell, pore;       // (pores), m^3: of the cells, and of their voids before any limiter
};

// The pores that this rank owned in the mesh before the present one.
struct PreviousPores {
  std::vector<std::int64_t> grains;     // (k, 4)
  std::vector<double> volume;           // (k), m^3, where the grains are now
  std::vector<std::int32_t> index;      // (k), among that mesh's local pores
};

struct Limited {
  std::int64_t pores, throats;  // over all ranks
};

// Collective unless said otherwise. Arrays of pores cover all cells that touch this rank's grains; owned() tells those that
// are its own, of which every cell of the pack is one on exactly one rank.
class PoreNetwork {
 public:
  // trusted_displacement: m; a mesh is not looked at before a grain or a wall has moved as far since it was known to hold.
  PoreNetwork(MPI_Comm comm, const Domain& domain, double trusted_displacement = 0.0);
  ~PoreNetwork();
  PoreNetwork(const PoreNetwork&) = delete;
  PoreNetwork& operator=(const PoreNetwork&) = delete;

  Outcome update(const GrainInput& input, bool rebuild);

  // Whether a mesh that is given up leaves its pores behind in previous(), for what they held to be handed on.
  void remember_previous(bool remember) { remember_previous_ = remember; }
  const PreviousPores& previous() const { return previous_; }

  // Throws InputError on all ranks with the message of the lowest rank that has one.
  void agree(const std::string& message) const;

  std::size_t pores() const { return mesh_.cells(); }                       // local
  std::size_t throats() const { return mesh_.facets(); }                    // local
  std::size_t grains() const { return directory_.input_size(); }            // local
  std::size_t groups() const { return wall_position_.size() / 6; }
  const bool* owned() const { return mesh_.owned.get(); }                        // local, (pores)
  void pore_centre(double* centre);                                         // local, (pores, 3)
  void unwrapped_centre(double* centre);                                    // local, (pores, 3): beside the cell's own grains
  // How deep a point, or its copy across periods, lies in each cell, as geometry::depth_in_cell has it: local, (pores).
  void depth(const Vector3& point, double* depth) const;
  void cell_volume(double* volume);                                         // local, (pores)
  const PoreVolumes& volumes();                                             // local; taken once for each place of the grains
  void grains_of_pore(std::int64_t* id) const;                              // local, (pores, 4)
  std::vector<std::int32_t> pores_at_wall(int wall) const;                  // local, in order
  void pores_of_throat(std::int32_t* pore) const;                           // local, (throats, 2)
  void grains_of_throat(std::int64_t* id) const;                            // local, (throats, 3)
  void owned_throats(bool* owned) const;                                    // local, (throats)
  ThroatSections throat_sections();                                         // local
  // The same in passing, by blocks in the order of the throats: local.
  void for_each_throat_block(const std::function<void(const geometry::ThroatBlock&)>& visit);

  // Pores and throats that FLOW's limiter would touch: open area below a share of the facet, void below a share of the cell.
  Limited limited(double least_open_share, double least_void_share);

  // force (n, 3): on the caller's grains; wall_force (groups, 6): outward, over all ranks.
  void forces(const double* pressure, geometry::ForceLaw law, double* force, double* wall_force);

  // The part of a pressure's gradient (3), Pa/m, along walls, within the pores: wall_force (groups, 6), outward, over all ranks.
  void wall_forces_of_gradient(const double* gradient, double* wall_force);

  // Rates of change of the pores' volumes, m^3/s, for given velocities of the caller's grains (n, 3) and outward speeds of the
  // walls (groups, 6), m/s. Out: rate (pores).
  void volume_rate(const double* velocity, const double* wall_velocity, double* rate);

  NetworkReport report() const;

  // For the flow solver and the response between its solves. exchange() is collective the first time after a mesh was made.
  MPI_Comm communicator() const { return comm_; }
  const Domain& domain() const { return domain_; }
  const Mesh& mesh() const { return mesh_; }
  const LocalGrains& local_grains() const { return local_; }
  GrainView view() const;
  std::size_t own_grains() const { return own_.size(); }               // of the mesh, in its own order
  const Halo& halo() const { return halo_; }
  const GrainDirectory& directory() const { return directory_; }
  const std::vector<std::size_t>& wall_facets() const { return wall_facets_; }  // facets of cells that have walls
  const PoreExchange& exchange();
  std::int64_t mesh_number() const { return mesh_number_; }  // changes whenever the mesh does
  bool meshed() const { return meshed_; }                    // the same on all ranks

 private:
  // Whether the mesh at hand could be kept or repaired.
  std::optional<Outcome> keep(const GrainInput& input);
  void mesh_changed();
  void rebuild(const GrainInput& input);
  void mesh_anew(const GrainInput& input);
  void leave_behind();
  void place(const GrainInput& input, bool continuous);
  void sort_local_grains();
  void refresh_local_grains();

  MPI_Comm comm_;
  Domain domain_;
  std::array<double, 3> period_{}, quantum_{};
  std::vector<double> wall_position_;   // (groups, 6)
  std::vector<geometry::Four> local_force_;  // (local grains), N, of the last call of forces
  OwnGrains own_;
  Halo halo_;
  LocalGrains local_;
  WallSpheres walls_{};
  Mesh mesh_;
  std::vector<std::size_t> wall_facets_;  // facets of cells that have walls
  GrainDirectory directory_;
  void look();
  double displacement_since_look() const;

  double trusted_displacement_;
  OwnGrains seen_;                      // where trusted_displacement_ > 0
  std::vector<double> seen_walls_;
  bool remember_previous_ = false;
  PreviousPores previous_;
  PoreVolumes volumes_;
  bool volumes_known_ = false;
  PoreExchange exchange_;
  bool exchange_built_ = false;
  std::int64_t mesh_number_ = 0;
  bool meshed_ = false;
  double halo_width_ = 0.0;
  std::int64_t hidden_ = 0;
  NetworkReport report_{};
};

}  // namespace poreslip
