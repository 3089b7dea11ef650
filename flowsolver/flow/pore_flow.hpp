// Flow through a pore network on PETSc: equations (7)-(13). Steady, implicit and explicit.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "flow/conductance.hpp"
#include "flow/linear_solver.hpp"
#include "network/pore_network.hpp"

namespace poreslip::flow {

// What acts in one solve. Arrays over all local pores, as the network counts them; values at copies are not used.
struct Conditions {
  const bool* fixed;            // pores whose pressure is given
  const double* pressure;       // before, and where fixed the given value, Pa
  const double* source;         // given inflow, m^3/s
  const double* volume_rate;    // dV/dt of the pores, m^3/s
  const double* start = nullptr;  // of the iteration, Pa; null: `pressure`
};

struct SolveReport {
  std::int64_t unknowns;        // over all ranks
  std::int64_t isolated;        // free pores cut off from every given pressure, over all ranks; they keep their own
  std::int64_t limited_pores, limited_throats;
  int iterations;
  int reason;                   // PETSc's
  double residual;              // norm at the end
  double imbalance;             // m^3/s, of all unknowns together, before their balance was closed
  bool preconditioner_kept;
  std::int64_t substeps;        // of explicit
  double assemble, setup, solve;  // seconds of this rank
};

// m^3/s over all ranks.
struct Balance {
  double missing, of_each;      // over free pores, what must come from outside: the sum, and the sum of the sizes
  double throughput;            // what given pressures, sources, volume rates and storage bring in and take out
};
struct Driven {
  double by_differences;        // of pressure and body force
  double by_each;               // that pressures, body force and storage would drive if nothing stood against them
};

class PoreFlow {
 public:
  // options: PETSc options as on a command line; those of the linear solver have the prefix -flow_.
  PoreFlow(PoreNetwork& network, const Fluid& fluid, ConductanceLaw law, const Limiter& limiter, const std::string& options);
  PoreFlow(const PoreFlow&) = delete;
  PoreFlow& operator=(const PoreFlow&) = delete;

  // Collective. Takes up the network's present geometry. body_force (3), Pa/m.
  void refresh(const double* body_force);

  // Throws InputError if the network has another mesh than at the last refresh; so do all methods that need it. The same on all ranks.
  void require_current() const;

  // Collective. Sets C / l of the throats that this rank owns instead (for comparison with other codes), m^3/(Pa s).
  void set_conductance(const double* conductance);
  std::vector<double> conductance() const;

  // Collective. Backward Euler over dt (10)-(13), or the steady state for dt <= 0. Out: pressure (pores), Pa, everywhere.
  SolveReport solve(const Conditions& conditions, double dt, double relative_tolerance, double* pressure);

  // Collective. Explicit (9) in as many equal steps as its limit asks for; limit_share of the limit each. Out: pressure (pores), Pa, at the end,
  // and flowing (pores), Pa, the mean of those that the fluid flowed by.
  SolveReport step_explicit(const Conditions& conditions, double dt, double limit_share, std::int64_t most_substeps,
                            double* pressure, double* flowing);

  // Collective. (7) after a solve that ended at `pressure`, by which the fluid flowed. change (pores), Pa/s, null: steady. Out: supply (pores), m^3/s,
  // what must come from outside for every pore's balance to hold: through a face where the pressure is given, else 0.
  Balance balance(const Conditions& conditions, const double* pressure, const double* change, double* supply);

  // Collective. Flows through all throats one by one, and, null: steady, into storage.
  Driven driven(const double* pressure, const double* change) const;

  // Collective. Net flow out of each local pore to its neighbours, m^3/s, for pressures of all local pores (8).
  void outflow(const double* pressure, double* flow);

  const std::vector<double>& pore_storage() const { return storage_; }
  std::int64_t limited_throats() const { return throats_.limited; }
  std::int64_t limited_pores() const { return limited_pores_; }

 private:
  // Over this rank's unknowns: of the right sides and of the sizes of their terms, m^3/s; of the squares of the terms' scale.
  struct Sums {
    double right = 0.0, terms = 0.0, squares = 0.0;
  };
  // A side of a throat of another rank: which unknowns it joins, counted over all ranks; other: -1 if its pressure is given.
  struct RemotePlace {
    PetscInt row, other;
  };
  struct Edge {
    PetscInt row;
    double conductance;          // to pores of given pressure
  };

  void number(const bool* fixed, bool stored);
  void look_for_parts();
  void find_remote();
  template <class Visit>
  void for_each_side(std::int32_t pore, Visit visit) const;
  double given_mean(const Conditions& conditions) const;
  double sealed_mean(const Conditions& conditions, bool stored, double dt) const;
  Sums assemble(const Conditions& conditions, const double* pressure, double dt, double reference, bool columns, bool values);
  void follow_mesh();
  void report_divergence(const SolveReport& report) const;

  PoreNetwork& network_;
  Fluid fluid_;
  ConductanceLaw law_;
  Limiter limiter_;
  MPI_Comm comm_;
  Throats throats_;
  std::vector<double> storage_;
  std::int64_t limited_pores_ = 0;

  std::vector<std::uint8_t> fixed_;  // 1 where the pressure is given, at copies too
  std::int64_t cut_off_ = 0;         // owned pores that nothing determines, over all ranks
  std::vector<PetscInt> column_;     // global number of each local pore, -1 where fixed
  std::vector<std::int32_t> free_;   // owned pores that are unknowns
  PetscInt first_row_ = 0, all_rows_ = 0;

  std::int64_t numbered_mesh_ = -1;  // what the numbers are of
  bool numbered_stored_ = false, numbered_throats_ = false;
  std::vector<std::uint8_t> given_;
  bool sealed_ = false;              // no pressure is given anywhere

  std::vector<std::vector<std::int64_t>> outgoing_;  // for each rank that owns a side's pore (or a copy's, itself): 2 * throat + side
  std::vector<RemotePlace> incoming_;                // of such throats here, in the order in which they arrive,
  std::vector<std::int32_t> incoming_by_row_;        // and which of them they are, row by row
  std::vector<Edge> edges_;                          // rows with neighbours of given pressure
  double matrix_sum_ = 0.0;                          // of this rank's rows
  LinearSolver solver_;
  bool structured_ = false;             // the system is of the numbers at hand
  std::vector<PetscInt> isolated_;      // rows of pores without any open throat, where nothing is stored
  double assembled_dt_ = -1.0;          // of the entries' values, below 0: none
  std::int64_t mesh_followed_ = -1;
  std::vector<PetscInt> row_at_setup_;  // of each local pore when the preconditioner was set up, -1: none; empty: unrelated
};

}  // namespace poreslip::flow
