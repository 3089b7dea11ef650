"""The onset of slip is found within its stated uncertainty on made-up runs whose onset is known."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import synthetic_run as synthetic  # noqa: E402
from postproc import onset, smoothing  # noqa: E402
from postproc.run_files import read_run  # noqa: E402


def onsets_of(tmp_path: Path, **changes: object) -> onset.RunOnsets:
    return onset.find_onsets(read_run(synthetic.write_run(tmp_path, synthetic.Synthetic(**changes))))


def test_noise_free_onset_is_found_within_a_sampling_interval(tmp_path: Path) -> None:
    found = onsets_of(tmp_path, number=2, onset_strain=1.2e-3, other_onset_strain=1.8e-3)
    assert found.faster == "left"
    assert found.onset.at["strain"].value == pytest.approx(1.2e-3, abs=3.1e-3 / 399)
    assert found.slips["right"].onset.at["strain"].value == pytest.approx(1.8e-3, abs=3.1e-3 / 399)
    made = synthetic.Synthetic(number=2, onset_strain=1.2e-3)
    expected = float(synthetic.sigma_n(np.array([1.2e-3]), made)[0])
    pressure = synthetic.TARGET * 1.2e-3 / 3.1e-3
    assert found.onset.at["sigma_n_Pa"].value == pytest.approx(expected, rel=5e-3)
    assert found.onset.at["sigma_n_minus_max_p_Pa"].value == pytest.approx(expected - pressure, rel=1e-2)
    assert found.onset.at["sigma_n_minus_mean_p_Pa"].value == pytest.approx(expected - 0.5 * pressure, rel=1e-2)
    assert found.onset.at["time_s"].value == pytest.approx(1.2e-3 / 1.56, rel=1e-2)


def test_uncertainty_is_half_the_range_over_the_thresholds_when_nothing_else_matters(tmp_path: Path) -> None:
    found = onsets_of(tmp_path, samples=20000, ramp_width=1e-5, slip_per_strain=0.1).onset
    low, high = found.at_threshold[0.0025]["strain"], found.at_threshold[0.01]["strain"]
    assert high - low == pytest.approx(0.0075 * synthetic.DIAMETER / 0.1, rel=0.05)
    assert found.at["strain"].uncertainty == pytest.approx(0.5 * (high - low), rel=0.02)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("elastic", [0.0, 2e-3, 8e-3])
def test_onset_with_noise_and_elastic_part_is_within_its_uncertainty(tmp_path: Path, seed: int, elastic: float) -> None:
    found = onsets_of(tmp_path, seed=seed, slip_noise=1e-6, stress_noise=2e5, elastic_slip=elastic).onset
    for name, expected in (("strain", 1.2e-3), ("sigma_n_Pa", 2.2e7)):
        assert abs(found.at[name].value - expected) < found.at[name].uncertainty
    assert found.at["strain"].uncertainty < 0.1 * 1.2e-3


def test_elastic_part_does_not_count_as_slip(tmp_path: Path) -> None:
    found = onsets_of(tmp_path, onset_strain=None, elastic_slip=0.02)
    assert found.onset is None and found.faster is None
    assert found.slips["left"].largest < 1e-9
    assert found.slips["left"].elastic_m_per_Pa == pytest.approx(0.02 / (0.5 * 1.005 * 2e10), rel=2e-3)


def test_sense_of_the_slip_does_not_matter(tmp_path: Path) -> None:
    directory = synthetic.write_run(tmp_path, synthetic.Synthetic())
    run = read_run(directory)
    mirrored = run.history.assign(slip_left_m=-run.history["slip_left_m"], slip_right_m=-run.history["slip_right_m"])
    mirrored.to_csv(directory / "history.csv", index=False)
    assert onset.find_onsets(read_run(directory)).onset == onset.find_onsets(run).onset


def test_a_run_stopped_just_after_the_onset_says_so(tmp_path: Path) -> None:
    found = onsets_of(tmp_path, end_strain=1.23e-3)
    assert found.onset.cut_short and 0.02 not in found.onset.at_threshold
    assert found.onset.at["strain"].value == pytest.approx(1.2e-3, rel=5e-3)


def test_a_spike_across_the_threshold_is_not_the_onset() -> None:
    time = np.linspace(0.0, 1.0, 11)
    slip = np.array([0, 0, 1.5, 0, 0, 0.5, 0.5, 1.5, 2.5, 3, 3.0])
    assert onset.passage(time, slip, 1.0) == pytest.approx(0.65)
    assert onset.passage(time, slip, 4.0) is None


def test_other_definitions_of_the_onset(tmp_path: Path) -> None:
    found = onsets_of(tmp_path)
    assert found.strain_rate.at["strain"].value == pytest.approx(1.2e-3, abs=2e-5)
    assert found.peak_stress is None  # the made-up stress stays at its largest value to the end
    directory = synthetic.write_run(tmp_path, synthetic.Synthetic(seed=2))
    history = read_run(directory).history
    strain = history["strain"]
    history.assign(sigma_n_Pa=2e7 - 1e13 * (strain - 1.5e-3) ** 2).to_csv(directory / "history.csv", index=False)
    peak = onset.find_onsets(read_run(directory)).peak_stress
    assert peak.at["strain"].value == pytest.approx(1.5e-3, abs=1e-5)
    # 0.5 % of the peak is reached sqrt(1e5 / 1e13) = 1e-4 from it
    assert peak.at["strain"].uncertainty == pytest.approx(1e-4, rel=0.1)


def test_the_elastic_part_brings_the_onset_as_measured_forward(tmp_path: Path) -> None:
    found = onsets_of(tmp_path, elastic_slip=2e-3, slip_per_strain=0.1)
    # 0.1 (e - 1.2e-3) + 2e-3 e = 0 beyond the ramp's knee: the elastic 2.4 um at the onset take 2.4e-6 / 0.102 of strain
    assert found.as_measured.at["strain"].value == pytest.approx(1.2e-3 - 2.4e-6 / 0.102, abs=4e-6)
    without = onsets_of(tmp_path, number=2, elastic_slip=0.0, other_onset_strain=1.8e-3)
    assert without.as_measured.at["strain"].value == pytest.approx(without.onset.at["strain"].value, rel=1e-3)
    assert onsets_of(tmp_path, number=3, onset_strain=None).as_measured is None


def test_no_rate_onset_where_the_fault_is_upright(tmp_path: Path) -> None:
    assert onsets_of(tmp_path, scene="supplement").strain_rate is None


def test_local_line_is_exact_on_a_line_and_averages_noise() -> None:
    time = np.sort(np.random.default_rng(1).uniform(0.0, 5.0, 300))
    value, slope = smoothing.local_line(time, 3.0 + 2.0 * time, 0.2)
    assert np.allclose(value, 3.0 + 2.0 * time, atol=1e-10) and np.allclose(slope, 2.0, atol=1e-8)
    noisy = np.random.default_rng(2).standard_normal(300)
    assert smoothing.smooth(time, noisy).std() < 0.6 * noisy.std()
    assert smoothing.noise(time, 7.0 * noisy) == pytest.approx(7.0, rel=0.2)
