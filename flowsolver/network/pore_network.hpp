// The pore network of a moving grain pack: its mesh, kept while it is valid, and what is asked of it.
#pragma once

#include <mpi.h>

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "geometry/facets.hpp"
#include "network/grain_directory.hpp"
#include "network/grain_input.hpp"
#include "tessellation/domain.hpp"
#include "tessellation/halo.hpp"
#include "tessellation/mesh.hpp"

namespace poreslip {

enum class Outcome { kept, rebuilt };

struct NetworkReport {
  std::int64_t grains, pores, throats;       // over all ranks
  std::int64_t hidden_grains;                // inside others, without a cell, over all ranks
  std::int64_t kept, rebuilt;                // updates
  std::int64_t exact_tests;                  // of the last certificate, over all ranks
  double halo;                               // m
  double tessellate, certify, geometry, forces;  // seconds of this rank
};

struct ThroatSections {
  std::vector<double> facet_area, open_area, perimeter, length;  // m^2, m^2, m, m
};

struct Limited {
  std::int64_t pores, throats;  // over all ranks
};

// Collective unless said otherwise. Arrays of pores cover all cells that touch this rank's grains; owned() tells those that
// are its own, of which every cell of the pack is one on exactly one rank.
class PoreNetwork {
 public:
  PoreNetwork(MPI_Comm comm, const Domain& domain);
  ~PoreNetwork();
  PoreNetwork(const PoreNetwork&) = delete;
  PoreNetwork& operator=(const PoreNetwork&) = delete;

  Outcome update(const GrainInput& input, bool rebuild);

  // Throws InputError on all ranks with the message of the lowest rank that has one.
  void agree(const std::string& message) const;

  std::size_t pores() const { return mesh_.cells(); }                       // local
  std::size_t throats() const { return mesh_.facets(); }                    // local
  std::size_t grains() const { return directory_.input_size(); }            // local
  std::size_t groups() const { return wall_position_.size() / 6; }
  const bool* owned() const { return owned_.get(); }                        // local, (pores)
  void pore_centre(double* centre);                                         // local, (pores, 3)
  void cell_volume(double* volume);                                         // local, (pores)
  void pore_volume(double* volume);                                         // local, (pores)
  void grains_of_pore(std::int64_t* id) const;                              // local, (pores, 4)
  void pores_of_throat(std::int32_t* pore) const;                           // local, (throats, 2)
  void grains_of_throat(std::int64_t* id) const;                            // local, (throats, 3)
  void owned_throats(bool* owned) const;                                    // local, (throats)
  ThroatSections throat_sections();                                         // local

  // Pores and throats that FLOW's limiter would touch: open area below a share of the facet, void below a share of the cell.
  Limited limited(double least_open_share, double least_void_share);

  // force (n, 3): on the caller's grains; wall_force (groups, 6): outward, over all ranks.
  void forces(const double* pressure, geometry::ForceLaw law, double* force, double* wall_force);

  NetworkReport report() const;

 private:
  bool keep(const GrainInput& input);
  void rebuild(const GrainInput& input);
  void place(const GrainInput& input, bool continuous);
  void sort_local_grains();
  void refresh_local_grains();
  void add_step_forces(const double* pressure, double* fx, double* fy, double* fz) const;
  GrainView view() const;

  MPI_Comm comm_;
  Domain domain_;
  std::array<double, 3> period_{}, quantum_{};
  std::vector<double> wall_position_;   // (groups, 6)
  OwnGrains own_;
  Halo halo_;
  LocalGrains local_;
  WallSpheres walls_{};
  Mesh mesh_;
  std::unique_ptr<bool[]> owned_;
  std::vector<std::size_t> wall_facets_;  // facets of cells that have walls
  GrainDirectory directory_;
  bool meshed_ = false;
  double halo_width_ = 0.0;
  std::int64_t hidden_ = 0;
  NetworkReport report_{};
};

}  // namespace poreslip
