"""Analytic references of studies: what an observable should be, by name. Sources stand beside each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from postproc.observables import Layer, NotObserved, Observed, ResultFiles, permeability_of, report

#: Permeability over the diameter squared of touching lattices in Stokes flow: Zick & Homsy, J. Fluid Mech. 115, 13 (1982).
ZICK_HOMSY = {"sc": 2.520e-3, "bcc": 5.014e-4, "fcc": 1.725e-4}
#: Drag of a sphere in a simple cubic lattice over Stokes' drag of one alone, by the part of the volume that is solid: their Table 2.
ZICK_HOMSY_DRAG = {
    0.000125: 1.096, 0.001: 1.212, 0.008: 1.525, 0.027: 2.008, 0.064: 2.810, 0.125: 4.292, 0.216: 7.442, 0.343: 15.4, 0.45: 28.1, 0.5236: 42.1,
}  # fmt: skip


def terzaghi_degree(time_factor: np.ndarray) -> np.ndarray:
    """(n,): mean degree of consolidation of a layer that drains at one face, U = 1 - sum 2 / M^2 exp(-M^2 T_v), M = pi (2 m + 1) / 2."""
    root = np.pi * (2 * np.arange(500) + 1) / 2
    return 1.0 - (2.0 / root**2 * np.exp(-np.outer(np.maximum(time_factor, 0.0), root**2))).sum(axis=1)


def terzaghi(files: ResultFiles, observed: Observed) -> np.ndarray:
    """Degree of consolidation at the observed times. Stiffness from [companion.dry], permeability from [companion.darcy]."""
    if observed.abscissa is None:
        raise NotObserved('Terzaghi\'s solution is a curve over time, as the observable "consolidation" is')
    layer = Layer(files)
    permeable = permeability_of(files.companion("darcy")) / layer.inputs["fluid"]["viscosity_Pa_s"]
    diffusivity = permeable / (1.0 / layer.stiffness + layer.storage)
    return layer.mean_over_ramp(observed.abscissa, lambda since: terzaghi_degree(diffusivity * since / layer.height**2))


def zick_homsy(files: ResultFiles, observed: Observed, diameter_m: float, lattice: str = "") -> np.ndarray:
    """Permeability of a touching lattice, m^2; the lattice is an argument, or the setting's parameter of that name."""
    name = str(lattice or files.setting.get("lattice", "")).lower()
    if name not in ZICK_HOMSY:
        raise NotObserved(f"Zick & Homsy's value is known for the lattices {', '.join(ZICK_HOMSY)}, not for {name or 'none'}")
    return np.array([ZICK_HOMSY[name] * diameter_m**2])


def zick_homsy_drag(files: ResultFiles, observed: Observed, diameter_m: float, concentration: float | None = None) -> np.ndarray:
    """Permeability of a simple cubic lattice, m^2: k = d^2 / (18 c K(c)); c, solid over volume, is an argument, or the setting's parameter `concentration`."""
    c = files.setting.get("concentration") if concentration is None else concentration
    drag = next((drag for known, drag in ZICK_HOMSY_DRAG.items() if c is not None and np.isclose(float(c), known, rtol=1e-6)), None)
    if drag is None:
        raise NotObserved(f"Zick & Homsy's drag is known for the concentrations {', '.join(map(str, ZICK_HOMSY_DRAG))}, not for {'none' if c is None else c}")
    return np.array([diameter_m**2 / (18.0 * float(c) * drag)])


def kozeny_carman(files: ResultFiles, observed: Observed, diameter_m: float) -> np.ndarray:
    """Permeability of a random pack, m^2: k = phi^3 d^2 / (180 (1 - phi)^2), with the porosity of the report (Carman 1937)."""
    found = report(files.directory)
    porosity = found.get("porosity") or found.get("last", {}).get("porosity")
    if porosity is None:
        raise NotObserved("the report has no porosity")
    return np.array([porosity**3 * diameter_m**2 / (180.0 * (1.0 - porosity) ** 2)])


def fourier(
    files: ResultFiles, observed: Observed, wave_length_m: float, viscosity_Pa_s: float, compressibility_per_Pa: float, amplitude_Pa: float = 1.0
) -> np.ndarray:
    """Amplitude of a decaying wave of pressure, Pa: exp(-t / tau), tau = porosity compressibility viscosity (wave length / 2 pi)^2 / k.

    Permeability k and porosity are those of [companion.steady]; t is the setting's --dt times the steps that its run took.
    """
    found = report(files.companion("steady"))
    for name in ("porosity", "permeability"):
        if found.get(name) is None:
            raise NotObserved(f"the report of [companion.steady] has no {name}")
    if "--dt" not in files.setting:
        raise NotObserved("the decay of a wave is known at a time, that of the parameter --dt")
    storage = found["porosity"] * compressibility_per_Pa
    tau = storage * viscosity_Pa_s * (wave_length_m / (2.0 * np.pi)) ** 2 / found["permeability"]
    time = float(files.setting["--dt"]) * report(files.directory).get("steps", 1)
    return np.array([amplitude_Pa * np.exp(-time / tau)])


#: Name of an analytic reference to its function: files, what was observed, arguments -> values like the observed ones.
ANALYTIC: dict[str, Callable[..., np.ndarray]] = {
    "terzaghi": terzaghi,
    "zick_homsy": zick_homsy,
    "zick_homsy_drag": zick_homsy_drag,
    "kozeny_carman": kozeny_carman,
    "fourier": fourier,
}
#: Companions of the measured run that a reference reads.
COMPANIONS_OF_ANALYTIC: dict[str, tuple[str, ...]] = {"terzaghi": ("dry", "darcy"), "fourier": ("steady",)}
