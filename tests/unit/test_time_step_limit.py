"""The longest stable time step: the formula against the spectra of lattices, and what a case beyond it is told."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from coupling.case.files import load_case
from coupling.case.time_step_limit import stable_time_step
from coupling.errors import InputError
from coupling.stability.contact_spectrum import Contacts, stable_time_step as longest_by_spectrum

KN, MASS, RADIUS = 8e7, 1.1e-5, 1e-3


def chain(length: int, ks: float, gamma: float) -> Contacts:
    """A ring of touching grains, in the spectrum's eyes: each pushes the next along x."""
    first = np.arange(length)
    ones = np.ones(length)
    normal = np.tile([1.0, 0.0, 0.0], (length, 1))
    return Contacts(first, (first + 1) % length, normal, KN * ones, ks * ones, 0.5 * MASS * gamma * ones, MASS * ones, RADIUS * ones)


def cubic(side: int, ks: float) -> Contacts:
    """A periodic simple cubic lattice."""
    number = np.arange(side**3).reshape(side, side, side)
    first, second, normal = [], [], []
    for axis in range(3):
        first.append(number.ravel())
        second.append(np.roll(number, -1, axis=axis).ravel())
        normal.append(np.tile(np.eye(3)[axis], (side**3, 1)))
    one = np.ones(3 * side**3)
    grains = np.ones(side**3)
    return Contacts(np.concatenate(first), np.concatenate(second), np.concatenate(normal), KN * one, ks * one, 0 * one, MASS * grains, RADIUS * grains)


def test_spectrum_of_a_chain():
    # Neighbours against each other: omega^2 = 4 k_n / m, so dt = 2 / omega = sqrt(m / k_n).
    assert longest_by_spectrum(chain(10, 0.0, 0.0)) == pytest.approx(math.sqrt(MASS / KN), rel=1e-6)
    # Damped by gamma m / 2 in each contact: 4 t^2 + 4 gamma sqrt(m / k_n) t = 4 in t = dt / sqrt(m / k_n).
    gamma = 0.7 / math.sqrt(MASS / KN)
    expected = (-0.7 + math.sqrt(0.7**2 + 4)) / 2 * math.sqrt(MASS / KN)
    assert longest_by_spectrum(chain(10, 0.0, gamma)) == pytest.approx(expected, rel=1e-3)


def test_spectrum_of_a_lattice_of_turning_grains():
    # All grains turn alike: each of the four contacts about an axis slips by 2 R theta, so omega^2 = 2 k_s R^2 * 4 / (0.4 m R^2) = 20 k_s / m.
    ks = 0.9 * KN
    assert longest_by_spectrum(cubic(4, ks)) == pytest.approx(2 / math.sqrt(20 * ks / MASS), rel=1e-4)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.5, 1.0])
def test_the_formula_is_safe_on_a_lattice(ratio):
    assert stable_time_step(MASS, KN, ratio, 0.0) < longest_by_spectrum(cubic(4, ratio * KN))


def test_damping_shortens_the_step():
    free = stable_time_step(MASS, KN, 0.5, 0.0)
    for damping, local in itertools.product((0.0, 1e6, 5e6), (0.0, 0.7)):
        with_damping = stable_time_step(MASS, KN, 0.5, damping, local)
        assert with_damping < free or damping == local == 0.0
    assert stable_time_step(MASS, KN, 0.5, 0.0, 0.7) == pytest.approx(free / math.sqrt(1.7), rel=1e-12)


REFUSED = {
    "as it is": ("loading.time_step_fraction=0.85", "at most 0.81"),
    "stiff in shear": ("material.shear_stiffness_ratio=1.0 loading.time_step_fraction=0.7", "at most 0.59"),
    "strong damping of contacts": ("material.restitution=0.01", "at most 0.41"),
    "local damping": ("material.local_damping=0.7 loading.time_step_fraction=0.65", "at most 0.6"),
}


@pytest.mark.parametrize(("settings", "expected"), REFUSED.values(), ids=REFUSED.keys())
def test_a_step_beyond_the_limit_is_refused(tmp_path: Path, settings: str, expected: str):
    path = tmp_path / "case.toml"
    path.write_text('scene = "sample"\nflow.kind = "none"\n')
    with pytest.raises(InputError, match="loading.time_step_fraction") as refusal:
        load_case(path, settings.split())
    assert expected in str(refusal.value)
    # What it names is accepted.
    holds = str(refusal.value).split("at most ")[1].split(".  ")[0].rstrip(".")
    load_case(path, [*settings.split(), f"loading.time_step_fraction={holds}"])


def test_without_friction_the_shear_stiffness_does_nothing(tmp_path: Path):
    path = tmp_path / "case.toml"
    path.write_text('scene = "sample"\nflow.kind = "none"\nmaterial.friction = 0.0\nmaterial.shear_stiffness_ratio = 1.0\nloading.time_step_fraction = 0.85\n')
    load_case(path)
