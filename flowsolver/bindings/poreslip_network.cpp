// Python module poreslip_network: arrays and an MPI communicator in, arrays and a report out. Defaults and checks of types and
// shapes are in flowsolver/network.py.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <memory>
#include <optional>

#include "network/pore_network.hpp"
#include "network/pore_response.hpp"
#include "tessellation/errors.hpp"

namespace nb = nanobind;
using namespace poreslip;

namespace {

template <class T, class Shape>
using In = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
template <class T>
using Out = nb::ndarray<nb::numpy, T>;

// A new array that Python owns.
template <class T>
Out<T> new_array(std::initializer_list<std::size_t> shape) {
  std::size_t size = 1;
  for (const std::size_t s : shape) size *= s;
  T* data = new T[size];
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return Out<T>(data, shape, owner);
}

template <class T>
Out<T> to_array(std::vector<T> values) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return Out<T>(kept->data(), {kept->size()}, owner);
}

}  // namespace

NB_MODULE(poreslip_network, m) {
  m.doc() = "Pore network of a grain pack: tessellation, geometry and pressure forces (C++ core; SI units).";
  nb::exception<InputError>(m, "InputError", PyExc_ValueError);
  nb::exception<ComputationError>(m, "ComputationError", PyExc_RuntimeError);

  nb::class_<PoreNetwork>(m, "PoreNetwork", "Pore network of a moving grain pack. Methods are collective unless they say local.")
      .def(
          "__init__",
          [](PoreNetwork* self, int communicator, std::array<double, 3> lower, std::array<double, 3> upper,
             std::array<bool, 3> periodic, double trusted_displacement) {
            new (self) PoreNetwork(MPI_Comm_f2c(communicator), Domain{lower, upper, periodic}, trusted_displacement);
          },
          nb::arg("communicator"), nb::arg("lower"), nb::arg("upper"), nb::arg("periodic"), nb::arg("trusted_displacement"),
          "communicator: Fortran handle, comm.py2f(); lower, upper: (3,) float64, m; periodic: (3,) bool; trusted_displacement: m")
      .def("agree", &PoreNetwork::agree, nb::arg("message"),
           "Raise InputError on all ranks if any rank passes a non-empty message.")
      .def(
          "update",
          [](PoreNetwork& self, In<std::int64_t, nb::shape<-1>> id, In<double, nb::shape<-1, 3>> position,
             In<double, nb::shape<-1>> radius, In<std::int32_t, nb::shape<-1>> group,
             In<double, nb::shape<-1, 6>> wall_position, bool rebuild) {
            const GrainInput input{id.shape(0),  id.data(),    position.data(),        radius.data(),
                                   group.data(), wall_position.shape(0), wall_position.data()};
            constexpr const char* name[] = {"kept", "repaired", "rebuilt"};
            return name[static_cast<int>(self.update(input, rebuild))];
          },
          nb::arg("id"), nb::arg("position"), nb::arg("radius"), nb::arg("group"), nb::arg("wall_position"),
          nb::arg("rebuild"),
          "id (n,) int64; position (n, 3) float64, m; radius (n,) float64, m; group (n,) int32; wall_position (G, 6) float64, "
          "m, the same on all ranks. Returns \"kept\", \"repaired\" or \"rebuilt\", the same on all ranks.")
      .def_prop_ro("pores", &PoreNetwork::pores, "Number of cells that touch this rank's grains (local).")
      .def_prop_ro("throats", &PoreNetwork::throats, "Number of facets that touch this rank's grains (local).")
      .def_prop_ro("groups", &PoreNetwork::groups, "Rows of wall_position of the last update.")
      .def_prop_ro("grains", &PoreNetwork::grains, "Number of grains of this rank's last update (local).")
      .def(
          "owned",
          [](const PoreNetwork& self) {
            auto out = new_array<bool>({self.pores()});
            std::copy_n(self.owned(), self.pores(), out.data());
            return out;
          },
          "(m,) bool, local: cells that this rank owns; over all ranks every cell once.")
      .def(
          "pore_centre",
          [](PoreNetwork& self) {
            auto out = new_array<double>({self.pores(), 3});
            self.pore_centre(out.data());
            return out;
          },
          "(m, 3) float64, m, local: centroid of each cell, inside the box along periodic directions.")
      .def(
          "unwrapped_centre",
          [](PoreNetwork& self) {
            auto out = new_array<double>({self.pores(), 3});
            self.unwrapped_centre(out.data());
            return out;
          },
          "(m, 3) float64, m, local: centroid of each cell, where its neighbours on this rank are beside it, across periods too.")
      .def(
          "depth",
          [](const PoreNetwork& self, std::array<double, 3> point) {
            auto out = new_array<double>({self.pores()});
            self.depth(point, out.data());
            return out;
          },
          nb::arg("point"),
          "point (3,), m. Returns (m,) float64, local: how deep the point, or its copy across periods, lies in each cell, at least 0 in the one that holds it.")
      .def(
          "cell_volume",
          [](PoreNetwork& self) {
            auto out = new_array<double>({self.pores()});
            self.cell_volume(out.data());
            return out;
          },
          "(m,) float64, m^3, local: volume of each cell.")
      .def(
          "pore_volume",
          [](PoreNetwork& self) {
            const std::vector<double>& volume = self.volumes().pore;
            auto out = new_array<double>({volume.size()});
            std::copy(volume.begin(), volume.end(), out.data());
            return out;
          },
          "(m,) float64, m^3, local: void volume of each cell, (4)-(5), before any limiter.")
      .def(
          "grains_of_pore",
          [](const PoreNetwork& self) {
            auto out = new_array<std::int64_t>({self.pores(), 4});
            self.grains_of_pore(out.data());
            return out;
          },
          "(m, 4) int64, local: ids of each cell's grains; -1 .. -6: walls x low, x high, y low, y high, z low, z high.")
      .def(
          "pores_at_wall", [](const PoreNetwork& self, int wall) { return to_array(self.pores_at_wall(wall)); }, nb::arg("wall"),
          "(k,) int32, local: the pores that touch a wall, 0 to 5 for x low ... z high, in order.")
      .def(
          "pores_of_throat",
          [](const PoreNetwork& self) {
            auto out = new_array<std::int32_t>({self.throats(), 2});
            self.pores_of_throat(out.data());
            return out;
          },
          "(f, 2) int32, local: the pores on the left and right of each throat.")
      .def(
          "grains_of_throat",
          [](const PoreNetwork& self) {
            auto out = new_array<std::int64_t>({self.throats(), 3});
            self.grains_of_throat(out.data());
            return out;
          },
          "(f, 3) int64, local: ids of each throat's grains, walls as in grains_of_pore.")
      .def(
          "owned_throats",
          [](const PoreNetwork& self) {
            auto out = new_array<bool>({self.throats()});
            self.owned_throats(out.data());
            return out;
          },
          "(f,) bool, local: throats that this rank owns; over all ranks every throat once.")
      .def(
          "throat_sections",
          [](PoreNetwork& self) {
            ThroatSections s = self.throat_sections();
            nb::dict out;
            out["facet_area"] = to_array(std::move(s.facet_area));
            out["open_area"] = to_array(std::move(s.open_area));
            out["perimeter"] = to_array(std::move(s.perimeter));
            out["length"] = to_array(std::move(s.length));
            return out;
          },
          "dict of (f,) float64, local: facet_area m^2, open_area m^2 (before any limiter), perimeter m (arcs and gaps), "
          "length m (between the cells' centroids).")
      .def(
          "limited",
          [](PoreNetwork& self, double open_share, double void_share) {
            const Limited l = self.limited(open_share, void_share);
            return std::tuple{l.pores, l.throats};
          },
          nb::arg("least_open_share"), nb::arg("least_void_share"),
          "Numbers of pores and throats, over all ranks, whose void or open area is below a share of the cell or facet.")
      .def(
          "forces",
          [](PoreNetwork& self, In<double, nb::shape<-1>> pressure, const std::string& law) {
            auto force = new_array<double>({self.grains(), 3});
            auto wall_force = new_array<double>({self.groups(), 6});
            self.forces(pressure.data(), law == "total" ? geometry::ForceLaw::total : geometry::ForceLaw::pressure,
                        force.data(), wall_force.data());
            return std::tuple{force, wall_force};
          },
          nb::arg("pressure"), nb::arg("law"),
          "pressure (m,) float64, Pa; law \"total\" or \"pressure\". Returns force (n, 3) float64, N, in the order of the last "
          "update, and wall_force (G, 6) float64, N, outward, summed over ranks.")
      .def(
          "wall_forces_of_gradient",
          [](PoreNetwork& self, std::array<double, 3> gradient) {
            auto wall_force = new_array<double>({self.groups(), 6});
            self.wall_forces_of_gradient(gradient.data(), wall_force.data());
            return wall_force;
          },
          nb::arg("gradient"),
          "gradient (3,), Pa/m, along the walls. Returns wall_force (G, 6) float64, N, outward, summed over ranks: of a pressure that in "
          "each cell is gradient . (x - its centroid).")
      .def(
          "volume_rate",
          [](PoreNetwork& self, In<double, nb::shape<-1, 3>> velocity, In<double, nb::shape<-1, 6>> wall_velocity) {
            auto out = new_array<double>({self.pores()});
            self.volume_rate(velocity.data(), wall_velocity.data(), out.data());
            return out;
          },
          nb::arg("velocity"), nb::arg("wall_velocity"),
          "velocity (n, 3) float64, m/s, in the order of the last update; wall_velocity (G, 6) float64, m/s, outward. Returns "
          "(m,) float64, m^3/s: rate of change of each pore's volume, from the coefficients of the forces (\"total\").")
      .def("remember_previous", &PoreNetwork::remember_previous, nb::arg("remember"),
           "Whether a mesh that is given up leaves its pores behind in previous() (local).")
      .def(
          "previous",
          [](const PoreNetwork& self) {
            const PreviousPores& p = self.previous();
            auto grains = new_array<std::int64_t>({p.volume.size(), 4});
            std::copy(p.grains.begin(), p.grains.end(), grains.data());
            auto index = new_array<std::int32_t>({p.index.size()});
            std::copy(p.index.begin(), p.index.end(), index.data());
            return std::tuple{grains, to_array(p.volume), index};
          },
          "Pores owned in the mesh before: ids of their grains (k, 4) int64, volumes (k,) float64, m^3, where the grains are "
          "now, and indices (k,) int32 among that mesh's pores (local).")
      .def(
          "same_pore_before",
          [](const PoreNetwork& self) {
            const auto& previous = self.mesh().previous;
            auto out = new_array<std::int32_t>({previous.size()});
            std::copy(previous.begin(), previous.end(), out.data());
            return out;
          },
          "After \"repaired\": (m,) int32, each pore's index in the mesh before, -1 for new ones. Else empty (local).")
      .def(
          "share",
          [](PoreNetwork& self, In<double, nb::shape<-1>> value) {
            auto out = new_array<double>({self.pores()});
            std::copy_n(value.data(), self.pores(), out.data());
            self.exchange().fetch(out.data());
            return out;
          },
          nb::arg("value"), "(m,) float64: values of owned pores, also at the copies that other ranks or periods see.")
      .def(
          "report",
          [](const PoreNetwork& self) {
            const NetworkReport r = self.report();
            nb::dict out, seconds;
            out["grains"] = r.grains;
            out["pores"] = r.pores;
            out["throats"] = r.throats;
            out["hidden_grains"] = r.hidden_grains;
            out["kept"] = r.kept;
            out["repaired"] = r.repaired;
            out["rebuilt"] = r.rebuilt;
            out["exact_tests"] = r.exact_tests;
            out["halo"] = r.halo;
            seconds["tessellate"] = r.tessellate;
            seconds["certify"] = r.certify;
            seconds["geometry"] = r.geometry;
            seconds["forces"] = r.forces;
            out["seconds"] = seconds;
            return out;
          },
          "Counts over all ranks; seconds of this rank.");

  nb::class_<PoreResponse>(m, "PoreResponse", "What pressures answer to moving grains between two solves of the flow. Collective.")
      .def(nb::init<PoreNetwork&>(), nb::arg("network"), nb::keep_alive<1, 2>())
      .def(
          "begin",
          [](PoreResponse& self, const std::string& law, In<double, nb::shape<-1>> pressure, In<double, nb::shape<-1>> drift,
             In<double, nb::shape<-1>> stiffness) {
            self.begin(law == "total" ? geometry::ForceLaw::total : geometry::ForceLaw::pressure, pressure.data(), drift.data(),
                       stiffness.data());
          },
          nb::arg("law"), nb::arg("pressure"), nb::arg("drift"), nb::arg("stiffness"),
          "Start an interval: pressure (m,) Pa; drift (m,) Pa/s; stiffness (m,) Pa/m^3, 1 / (beta V) or 0. Pressures are then pressure + "
          "time * drift - stiffness * swept.")
      .def("end", &PoreResponse::end, "End the interval (local).")
      .def(
          "step",
          [](PoreResponse& self, double dt, In<double, nb::shape<-1, 3>> velocity, In<double, nb::shape<-1, 6>> wall_velocity,
             nb::ndarray<double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu> force) {
            auto wall_force = new_array<double>({self.groups(), 6});
            self.step(dt, velocity.shape(0), nullptr, velocity.data(), wall_velocity.data(), force.data(), wall_force.data());
            return wall_force;
          },
          nb::arg("dt"), nb::arg("velocity"), nb::arg("wall_velocity"), nb::arg("force"),
          "One step over dt (s): velocity (n, 3) m/s in the order of the network's last update, wall_velocity (G, 6) m/s outward; force "
          "(n, 3) N before it, in place after it. Returns wall_force (G, 6) N, outward.")
      .def(
          "forces",
          [](const PoreResponse& self) {
            auto force = new_array<double>({self.grains(), 3});
            auto wall_force = new_array<double>({self.groups(), 6});
            self.forces(force.data(), wall_force.data());
            return std::tuple{force, wall_force};
          },
          "Forces of the present pressures: (n, 3) N in the order of the last step, and (G, 6) N, outward.")
      .def_prop_ro("seconds", &PoreResponse::seconds, "s that all steps took on this rank (local).")
      .def_prop_ro("elapsed", &PoreResponse::elapsed, "s, since the interval began (local).")
      .def("pressure", [](const PoreResponse& self) { return to_array(self.pressure()); }, "(m,) float64, Pa, of all pores that this rank sees.")
      .def("swept", [](const PoreResponse& self) { return to_array(self.swept()); },
           "(m,) float64, m^3, of the same: volume that each gained since the interval began.")
      .def("work", [](const PoreResponse& self) { return self.work(); },
           "J, of this rank: done on grains and walls, given by the fluid, sum of the sizes of the first's terms.")
      .def_prop_ro(
          "for_engine",
          [](PoreResponse& self) {
            return std::tuple{reinterpret_cast<std::uintptr_t>(&PoreResponse::step_for_engine), reinterpret_cast<std::uintptr_t>(&self)};
          },
          "Addresses of a C function and of its first argument, by which an engine makes the steps itself.");
}
