// Python module poreslip_flow: pore flow on PETSc for a poreslip_network.PoreNetwork. Defaults and checks are in
// flowsolver/flow.py.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "flow/petsc_options.hpp"
#include "flow/pore_flow.hpp"
#include "tessellation/errors.hpp"

namespace nb = nanobind;
using namespace poreslip;
using namespace poreslip::flow;

namespace {

template <class T>
using In = nb::ndarray<const T, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<nb::numpy, double>;

Out new_array(std::size_t size) {
  double* data = new double[size];
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return Out(data, {size}, owner);
}

Out copied(const std::vector<double>& values) {
  Out out = new_array(values.size());
  std::copy(values.begin(), values.end(), out.data());
  return out;
}

nb::dict to_dict(const SolveReport& r) {
  nb::dict out, seconds;
  out["unknowns"] = r.unknowns;
  out["isolated_pores"] = r.isolated;
  out["limited_pores"] = r.limited_pores;
  out["limited_throats"] = r.limited_throats;
  out["iterations"] = r.iterations;
  out["ksp_reason"] = r.reason;
  out["residual"] = r.residual;
  out["imbalance"] = r.imbalance;
  out["preconditioner_kept"] = r.preconditioner_kept;
  out["substeps"] = r.substeps;
  seconds["assemble"] = r.assemble;
  seconds["setup"] = r.setup;
  seconds["solve"] = r.solve;
  out["seconds"] = seconds;
  return out;
}

Conditions conditions(const In<bool>& fixed, const In<double>& pressure, const In<double>& source,
                      const In<double>& volume_rate) {
  return {.fixed = fixed.data(), .pressure = pressure.data(), .source = source.data(), .volume_rate = volume_rate.data()};
}

}  // namespace

NB_MODULE(poreslip_flow, m) {
  m.doc() = "Pore flow on PETSc (C++ core; SI units). Arrays of pores are those of the network, copies included.";
  nb::module_::import_("poreslip_network");

  m.def(
      "finalize",
      [] {
        PetscBool started = PETSC_FALSE, ended = PETSC_FALSE;
        PetscInitialized(&started);
        PetscFinalized(&ended);
        if (started && !ended) PetscFinalize();
      },
      "End PETSc, before MPI ends; prints what options such as -log_view ask for. Collective.");

  m.def("unused_options", &unused_options, nb::arg("given"),
        "Names, without their dash, of those options of the linear solver in a string that PETSc has not looked at so far (local).");
  m.def("known_options", &known_options, "Names, without their dash, of the linear solver's options (local).");

  nb::class_<PoreFlow>(m, "PoreFlow", "Flow through a PoreNetwork. Methods are collective unless they say local.")
      .def(
          "__init__",
          [](PoreFlow* self, PoreNetwork& network, double viscosity, double compressibility, const std::string& law,
             double least_open_share, double least_void_share, const std::string& options) {
            new (self) PoreFlow(network, Fluid{viscosity, compressibility},
                                law == "duct" ? ConductanceLaw::duct : ConductanceLaw::hydraulic_radius,
                                Limiter{least_open_share, least_void_share}, options);
          },
          nb::arg("network"), nb::arg("viscosity"), nb::arg("compressibility"), nb::arg("law"), nb::arg("least_open_share"),
          nb::arg("least_void_share"), nb::arg("options"), nb::keep_alive<1, 2>(),
          "viscosity Pa s; compressibility 1/Pa; law \"duct\" or \"hydraulic-radius\"; options: PETSc's, prefix -flow_.")
      .def(
          "refresh", [](PoreFlow& self, std::array<double, 3> body_force) { self.refresh(body_force.data()); },
          nb::arg("body_force"), "Take up the network's present geometry. body_force (3,), Pa/m.")
      .def("require_current", &PoreFlow::require_current, "InputError if the network has another mesh than at the last refresh; the same on all ranks.")
      .def(
          "set_conductance", [](PoreFlow& self, In<double> c) { self.set_conductance(c.data()); }, nb::arg("conductance"),
          "(t,) float64, m^3/(Pa s): C/l of the throats this rank owns, in place of the law's.")
      .def(
          "conductance", [](const PoreFlow& self) { return copied(self.conductance()); },
          "(t,) float64, m^3/(Pa s), local: C/l of the throats this rank owns, in the network's order.")
      .def(
          "storage", [](const PoreFlow& self) { return copied(self.pore_storage()); },
          "(m,) float64, m^3/Pa, local: compressibility times void volume of each pore, limited.")
      .def(
          "solve",
          [](PoreFlow& self, In<bool> fixed, In<double> pressure, In<double> source, In<double> volume_rate, double dt,
             double tolerance, std::optional<In<double>> start) {
            Out out = new_array(pressure.shape(0));
            Conditions given = conditions(fixed, pressure, source, volume_rate);
            if (start) given.start = start->data();
            const SolveReport r = self.solve(given, dt, tolerance, out.data());
            return std::tuple{out, to_dict(r)};
          },
          nb::arg("fixed"), nb::arg("pressure"), nb::arg("source"), nb::arg("volume_rate"), nb::arg("dt"), nb::arg("tolerance"),
          nb::arg("start").none() = nb::none(),
          "Backward Euler over dt (s), or steady for dt <= 0. fixed (m,) bool; pressure (m,) Pa: before, and given values; source "
          "and volume_rate (m,) m^3/s; start (m,) Pa: of the iteration, None: pressure. Returns pressure (m,) and a report.")
      .def(
          "step_explicit",
          [](PoreFlow& self, In<bool> fixed, In<double> pressure, In<double> source, In<double> volume_rate, double dt,
             double limit_share, std::int64_t most_substeps) {
            Out out = new_array(pressure.shape(0)), flowing = new_array(pressure.shape(0));
            const SolveReport r = self.step_explicit(conditions(fixed, pressure, source, volume_rate), dt, limit_share,
                                                     most_substeps, out.data(), flowing.data());
            return std::tuple{out, flowing, to_dict(r)};
          },
          nb::arg("fixed"), nb::arg("pressure"), nb::arg("source"), nb::arg("volume_rate"), nb::arg("dt"),
          nb::arg("limit_share"), nb::arg("most_substeps"), "Explicit (9) over dt in equal steps within its limit. Returns pressure (m,), "
          "the mean of those that the fluid flowed by (m,), and a report.")
      .def(
          "balance",
          [](PoreFlow& self, In<bool> fixed, In<double> source, In<double> volume_rate, In<double> pressure, std::optional<In<double>> change) {
            Out supply = new_array(pressure.shape(0));
            const Balance b = self.balance(conditions(fixed, pressure, source, volume_rate), pressure.data(), change ? change->data() : nullptr, supply.data());
            return std::tuple{supply, b.missing, b.of_each, b.throughput};
          },
          nb::arg("fixed"), nb::arg("source"), nb::arg("volume_rate"), nb::arg("pressure"), nb::arg("change").none(),
          "What must come from outside for every pore's balance (7) to hold, (m,) m^3/s: through a face where the pressure is given, else 0. Of it, over "
          "free pores, the sum's size and the sum of the sizes; and the throughput, m^3/s over all ranks. pressure (m,) Pa: that the fluid flowed by; "
          "change (m,) Pa/s: None for steady.")
      .def(
          "driven",
          [](const PoreFlow& self, In<double> pressure, std::optional<In<double>> change) {
            const Driven d = self.driven(pressure.data(), change ? change->data() : nullptr);
            return std::tuple{d.by_differences, d.by_each};
          },
          nb::arg("pressure"), nb::arg("change").none(),
          "Flows through all throats one by one, m^3/s over all ranks: that differences of pressure and body force would drive, and that pressures, body "
          "force and storage would if nothing stood against them.")
      .def(
          "outflow",
          [](PoreFlow& self, In<double> pressure) {
            Out out = new_array(pressure.shape(0));
            self.outflow(pressure.data(), out.data());
            return out;
          },
          nb::arg("pressure"), "(m,) float64, m^3/s: net flow out of each pore through its throats (8).");
}
