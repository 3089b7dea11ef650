"""What a study reads from the files of a run, and the analytic solutions that it is held against."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from synthetic_run import Synthetic, write_run

from postproc.observables import NotObserved, Observed, ResultFiles, block_stiffness, consolidation, of_history, of_report, onset, permeability, slip
from postproc.references import fourier, kozeny_carman, terzaghi, terzaghi_degree, zick_homsy, zick_homsy_drag


@pytest.fixture
def fault(tmp_path) -> ResultFiles:
    """A made-up run with an onset at a strain of 1.2e-3."""
    return ResultFiles(write_run(tmp_path, Synthetic()))


def test_a_column_at_its_end_at_a_place_and_as_a_curve(fault):
    table = pd.read_csv(fault.directory / "history.csv")
    assert of_history(fault, "sigma_n_Pa", {}, "").value == [table["sigma_n_Pa"].iloc[-1]]
    between = 0.3 * table["strain"][4] + 0.7 * table["strain"][5]
    expected = 0.3 * table["sigma_n_Pa"][4] + 0.7 * table["sigma_n_Pa"][5]
    assert of_history(fault, "sigma_n_Pa", {"strain": between}, "").value == pytest.approx([expected], rel=1e-9)
    curve = of_history(fault, "sigma_n_Pa", {}, "strain")
    assert len(curve.value) == len(table) and curve.abscissa[-1] == table["strain"].iloc[-1]
    with pytest.raises(NotObserved, match="strain goes to 0.0031 only, not to 1"):
        of_history(fault, "sigma_n_Pa", {"strain": 1.0}, "")
    with pytest.raises(NotObserved, match="no column sigma"):
        of_history(fault, "sigma", {}, "")


def test_places_on_a_column_that_falls(fault):
    """As a porosity does under load: where it first comes to the place, not its first line."""
    path = fault.directory / "history.csv"
    pd.DataFrame({"porosity": [0.40, 0.38, 0.36, 0.37], "strain_z": [0.0, 0.1, 0.3, 0.4]}).to_csv(path, index=False)
    for place, expected in ((0.40, 0.0), (0.39, 0.05), (0.37, 0.2), (0.36, 0.3)):
        assert of_history(fault, "strain_z", {"porosity": place}, "").value == pytest.approx([expected], abs=1e-12)
    with pytest.raises(NotObserved, match="porosity begins with 0.4 and goes down to 0.36 only, not to 0.35"):
        of_history(fault, "strain_z", {"porosity": 0.35}, "")
    with pytest.raises(NotObserved, match="porosity goes to 0.4 only, not to 0.41"):
        of_history(fault, "strain_z", {"porosity": 0.41}, "")


def test_onset_slip_and_stiffness(fault):
    assert onset(fault, "strain").value == pytest.approx([1.2e-3], rel=1e-2)
    assert onset(fault).value == pytest.approx([1e7 + 0.5 * 2.0e10 * 1.2e-3], rel=1e-2)
    assert block_stiffness(fault).value == pytest.approx([1.005 * 2.0e10], rel=1e-6)  # one wall bears a hundredth more
    last = pd.read_csv(fault.directory / "history.csv").iloc[-1]
    assert slip(fault).value == [max(last["slip_left_m"], last["slip_right_m"], key=abs)]
    assert slip(fault, "left").value == [last["slip_left_m"]]


def test_what_is_of_another_kind_of_run(fault, tmp_path):
    """Each a reason, and never a failure of the study."""
    with pytest.raises(NotObserved, match='scene = "sample", with a stress on top'):
        consolidation(fault)
    with pytest.raises(NotObserved, match="a curve over time"):
        terzaghi(fault, Observed.number(1.0))
    elsewhere = tmp_path / "of a sample"
    elsewhere.mkdir()
    (elsewhere / "history.csv").write_text("time_s,strain_z\n0,0\n")
    with pytest.raises(NotObserved, match="history.csv has no column strain; its columns: time_s, strain_z"):
        block_stiffness(ResultFiles(elsewhere))
    with pytest.raises(NotObserved, match="there is no case.json"):
        consolidation(ResultFiles(elsewhere))


def test_a_fault_that_does_not_slip_has_no_onset(tmp_path):
    files = ResultFiles(write_run(tmp_path, Synthetic(number=5, onset_strain=None)))
    with pytest.raises(NotObserved, match="did not slip"):
        onset(files)


def test_keys_of_reports(tmp_path):
    files = ResultFiles(tmp_path)
    with pytest.raises(NotObserved, match="no report"):
        of_report(files, "steps")
    (tmp_path / "report.json").write_text(json.dumps({"a": {"b": [1.5, 2.5]}, "ended": "so", "pore_network_by_rank": [{"permeability_m2": 1e-9}]}))
    assert of_report(files, "a.b.1").value == [2.5]
    assert permeability(files).value == [1e-9]
    for key, message in (("a.c", "has no a.c"), ("a.b.7", "has no a.b.7"), ("ended", "is 'so', not a number")):
        with pytest.raises(NotObserved, match=message):
            of_report(files, key)


def test_analytic_references(tmp_path):
    # T_v = 0.197 and 0.848 for half and nine tenths (Terzaghi 1925).
    assert terzaghi_degree(np.array([0.0, 0.1966, 0.8481])) == pytest.approx([0.0, 0.5, 0.9], abs=1e-3)
    (tmp_path / "out.json").write_text(json.dumps({"porosity": 0.4, "permeability": 1e-9}))
    files = ResultFiles(tmp_path, setting={"lattice": "BCC"})
    assert kozeny_carman(files, None, diameter_m=1e-3) == pytest.approx([0.4**3 * 1e-6 / (180 * 0.36)])
    assert zick_homsy(files, None, diameter_m=2.0) == pytest.approx([4 * 5.014e-4])
    with pytest.raises(NotObserved, match="lattices sc, bcc, fcc, not for hcp"):
        zick_homsy(files, None, diameter_m=2.0, lattice="hcp")
    # tau = 0.4 * 0.5 * 2e-9 / (4 pi^2) / 1e-9 s
    wave = {"wave_length_m": 1.0, "viscosity_Pa_s": 0.5, "compressibility_per_Pa": 2e-9}
    decaying = tmp_path / "decaying"
    decaying.mkdir()
    (decaying / "out.json").write_text(json.dumps({"steps": 3}))
    of_wave = ResultFiles(decaying, {"steady": tmp_path}, {"--dt": 0.005})
    assert fourier(of_wave, None, **wave) == pytest.approx([np.exp(-3 * 0.005 * 4 * np.pi**2 / 0.4)])
    # Their two figures for touching spheres are one another's.
    assert zick_homsy_drag(files, None, diameter_m=1.0, concentration=0.5236) == pytest.approx([2.520e-3], rel=1e-3)
    with pytest.raises(NotObserved, match="drag is known for the concentrations .*, not for none"):
        zick_homsy_drag(files, None, diameter_m=1.0)
    with pytest.raises(NotObserved, match="companion.dry"):
        files.companion("dry")
