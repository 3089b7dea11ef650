"""The verdicts on the paper's claims follow the runs: each claim is shown a run that has it and one that has not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import synthetic_run as synthetic  # noqa: E402
from postproc import claims, collapse  # noqa: E402
from postproc.claims_onset import difference_of_onsets  # noqa: E402
from postproc.command_line import findings_of, main  # noqa: E402
from postproc.results import measure  # noqa: E402
from postproc.run_sets import find_runs, sort_runs  # noqa: E402
from postproc.tables import run_table, scatter_table, variant_shifts  # noqa: E402


def verdicts(*directories: Path) -> dict[str, str]:
    """claim -> verdict of the first variant, over all packs if there are several."""
    found = claims.chief(findings_of(measure(sort_runs(find_runs(directories)[0]))))
    return {finding.claim: finding.verdict for finding in list(found.values())[0]}


def write_onsets(parent: Path, onsets: dict[int, float | None], seeds: tuple[int, ...] = (1,), wrong_side: bool = False, **changes: object) -> Path:
    for seed in seeds:
        for number, onset in onsets.items():
            other = onset if synthetic.PRESSURES[number][0] == synthetic.PRESSURES[number][1] or onset is None else onset + 6e-4
            if wrong_side and number in (2, 3):
                onset, other = other, onset
            synthetic.write_run(parent, synthetic.Synthetic(number=number, seed=seed, onset_strain=onset, other_onset_strain=other, **changes))
    (parent / "runs.json").write_text('{"runs": ["none"]}')
    return parent


def test_the_prototypes_onsets(tmp_path: Path) -> None:
    assert verdicts(write_onsets(tmp_path, synthetic.ONSETS)) == {
        "a": "reproduced", "b, strain": "reproduced", "b, sigma_n": "reproduced", "c": "not reproduced", "d": "reproduced",
        "e, contacts": "reproduced", "e, force": "reproduced", "f": "not reproduced", "g": "reproduced", "h": "not tested"}


@pytest.mark.parametrize("claim, changes", [
    ("e, contacts", {"contacts_lost": 0.5}), ("e, force", {"force_growth": 2.0}), ("g", {"bonds_broken": 1}), ("a", {"wrong_side": True}),
])
def test_a_run_without_it_does_not_reproduce_a_claim(tmp_path: Path, claim: str, changes: dict) -> None:
    found = verdicts(write_onsets(tmp_path, synthetic.ONSETS, **changes))
    assert found[claim] == "not reproduced"


def test_the_side_that_slips_first_counts_even_if_it_is_overtaken(tmp_path: Path) -> None:
    case = write_onsets(tmp_path, synthetic.ONSETS)
    for number, high, low in ((2, "left", "right"), (3, "right", "left")):
        path = case / f"case{number}-seed1" / "history.csv"
        table = pd.read_csv(path)
        strain = table["strain"].to_numpy()
        table[f"slip_{low}_m"] = synthetic.ramp(strain, 1.2e-3, synthetic.Synthetic())
        table[f"slip_{high}_m"] = synthetic.ramp(strain, 1.3e-3, synthetic.Synthetic(slip_per_strain=1.75))
        table.to_csv(path, index=False)
    assert verdicts(case)["a"] == "not reproduced"


def test_order_fails_when_case_4_comes_before_case_3_and_equality_holds_when_onsets_are_equal(tmp_path: Path) -> None:
    early = verdicts(write_onsets(tmp_path / "early", synthetic.ONSETS | {4: 1.15e-3}))
    assert early["b, strain"] == early["b, sigma_n"] == "not reproduced"
    equal = verdicts(write_onsets(tmp_path / "equal", synthetic.ONSETS | {1: 1.2e-3, 2: 1.2e-3, 3: 1.21e-3}))
    assert equal["c"] == equal["b, strain"] == "reproduced"


def collapse_of(case: Path) -> dict[str, collapse.Collapse]:
    return measure(sort_runs(find_runs([case])[0]))[0].packs[0].collapse


def test_case_1_may_come_a_little_later_but_not_much(tmp_path: Path) -> None:
    assert verdicts(write_onsets(tmp_path / "little", synthetic.ONSETS | {1: 1.22e-3}))["b, strain"] == "reproduced"
    assert verdicts(write_onsets(tmp_path / "much", synthetic.ONSETS | {1: 1.30e-3}))["b, strain"] == "not reproduced"


def test_uncertainty_of_a_difference_is_half_its_range_over_the_thresholds(tmp_path: Path) -> None:
    made = {"ramp_width": 1e-5, "elastic_slip": 0.0, "samples": 4000, "stiffness": 2e10}
    for number, rate in ((1, 0.35), (2, 0.1)):
        synthetic.write_run(tmp_path, synthetic.Synthetic(number=number, onset_strain=1.2e-3, slip_per_strain=rate, **made))
    (tmp_path / "runs.json").write_text('{"runs": ["none"]}')
    value, uncertainty = difference_of_onsets(measure(sort_runs(find_runs([tmp_path])[0]))[0].packs[0], 1, 2)
    assert value == pytest.approx(0.0, abs=2e4)
    assert uncertainty == pytest.approx(0.00375 * synthetic.DIAMETER * (1 / 0.1 - 1 / 0.35) * 1e10, rel=0.05)


def test_collapse_is_small_against_the_maximum_only_when_the_maximum_rules(tmp_path: Path) -> None:
    by_max = collapse_of(write_onsets(tmp_path / "max", synthetic.ONSETS))
    assert by_max["sigma_n_minus_max_p_Pa"].number < 0.1 < 1.0 < by_max["sigma_n_minus_mean_p_Pa"].number
    assert verdicts(write_onsets(tmp_path / "late", synthetic.ONSETS | {2: 2.6e-3, 3: 2.6e-3}))["d"] == "not reproduced"
    # stresses far above the pressures: the curves collapse as well (or badly) against the one as against the other
    stiff = write_onsets(tmp_path / "stiff", synthetic.ONSETS | {1: 1.0e-3, 2: 1.1e-3, 3: 1.1e-3}, stiffness=2e11)
    numbers = collapse_of(stiff)
    assert numbers["sigma_n_minus_max_p_Pa"].number < 0.5 and verdicts(stiff)["d"] == "not reproduced"


def test_collapse_says_when_it_cannot_tell_the_maximum_from_the_mean(tmp_path: Path) -> None:
    # Pressure and sigma_n of these runs rise at nearly one rate, so that 2 and 3 collapse with 1 even where they slip with 4.
    by_mean = write_onsets(tmp_path, synthetic.ONSETS | {2: 1.40e-3, 3: 1.40e-3})
    number = collapse_of(by_mean)["sigma_n_minus_max_p_Pa"]
    assert number.number < 0.5 and number.if_mean_ruled == pytest.approx(number.number, rel=0.02)
    found = [finding for finding in findings_of(measure(sort_runs(find_runs([by_mean])[0]))) if finding.claim in ("c", "d")]
    assert "2 and 3 on the way from 1 (0, maximum) to 4 (1, mean): 1.00 in strain" in found[0].figure
    assert "does not tell the maximum from the mean" in found[1].figure
    # where the maximum rules, the number for the mean's rule is still that of runs which follow it
    by_max = collapse_of(write_onsets(tmp_path / "max", synthetic.ONSETS))["sigma_n_minus_max_p_Pa"]
    assert by_max.if_mean_ruled == pytest.approx(number.number, rel=0.05) and by_max.if_mean_ruled > 1.5 * by_max.number


def test_collapse_without_a_dry_case_that_slides_and_with_blocks_that_part(tmp_path: Path) -> None:
    case = write_onsets(tmp_path, synthetic.ONSETS | {4: 2.4e-3, 5: None})
    found = [finding for finding in findings_of(measure(sort_runs(find_runs([case])[0]))) if finding.claim == "d"][0]
    assert found.verdict == "reproduced" and "(5) never moves that fast" in found.figure
    ratios = collapse_of(case)["sigma_n_Pa"].pressure_ratio
    assert ratios[1] == pytest.approx(synthetic.TARGET * synthetic.ONSETS[1] / 3.1e-3 / 1e7, rel=0.05)
    assert "does not tell sliding from opening" in found.figure and f"(4) {ratios[4]:.2f} of it" in found.figure


def test_collapse_number_by_hand(tmp_path: Path) -> None:
    # The made-up rates have the same shape, so that every level lies at the same distance from the onset: the spread of
    # 1 to 3 in sigma_n is that of their onset strains times d sigma_n / d strain = 1e10 Pa.
    measured = measure(sort_runs(find_runs([write_onsets(tmp_path, synthetic.ONSETS, samples=2000)])[0]))[0].packs[0].collapse["sigma_n_Pa"]
    together = np.array([synthetic.ONSETS[number] for number in collapse.TOGETHER])
    assert measured.spread == pytest.approx(1e10 * np.ptp(together), rel=0.03)
    assert measured.distance == pytest.approx(1e10 * (synthetic.ONSETS[4] - together.mean()), rel=0.03)
    assert measured.apart and measured.levels == collapse.LEVELS


def test_coulomb_holds_for_onsets_that_follow_it(tmp_path: Path) -> None:
    # sigma_n = 1e7 + 1e10 e must be (sigma_v - mu p)/(1 - mu) with p = p_t e / 3.1e-3 and mu = (sigma_h - sigma_v)/2 / sigma_n of case 5
    dry = synthetic.ONSETS[5]
    friction = 1e10 * dry / (1e7 + 1e10 * dry)
    onsets = {5: dry}
    for number, share in ((1, 1.0), (2, 1.0), (3, 1.0), (4, 0.5)):
        slope = share * synthetic.TARGET / 3.1e-3
        onsets[number] = (1e7 / (1 - friction) - 1e7) / (1e10 + friction * slope / (1 - friction))
    assert verdicts(write_onsets(tmp_path, onsets))["f"] == "reproduced"


def test_without_slip_it_says_so_and_nothing_is_not_a_number(tmp_path: Path) -> None:
    case = write_onsets(tmp_path, {number: None for number in range(1, 6)})
    found = verdicts(case)
    assert found["c"] == found["d"] == found["f"] == found["b, sigma_n"] == "not tested" and found["a"] == "not reproduced"
    assert main([str(case), "--dpi", "50"]) == 0
    page = (case / "plots" / "page.html").read_text()
    assert "no slip (largest" in page and "nan" not in page.replace("nance", "").lower()
    table = pd.read_csv(case / "plots" / "table.csv")
    assert list(table["slips"]) == ["no"] * 5 and table["onset_strain"].isna().all()


def test_a_dry_case_that_does_not_slip_comes_last_in_strain(tmp_path: Path) -> None:
    found = verdicts(write_onsets(tmp_path, synthetic.ONSETS | {5: None}))
    assert found["b, strain"] == "reproduced" and found["b, sigma_n"] == "not tested"


def test_one_run_only(tmp_path: Path) -> None:
    directory = synthetic.write_run(tmp_path, synthetic.Synthetic(samples=60))
    assert main([str(directory), "--out", str(tmp_path / "plots"), "--dpi", "50", "--pdf"]) == 0
    table = pd.read_csv(tmp_path / "plots" / "claims.csv")
    assert set(table.loc[table["claim"].isin(["a", "b, strain", "c", "d", "f", "h"]), "verdict"]) == {"not tested"}
    assert (tmp_path / "plots" / "slip.pdf").stat().st_size > 1000


def test_packs_are_judged_one_by_one_and_together(tmp_path: Path) -> None:
    case = synthetic.write_case(tmp_path / "case", seeds=(1, 2, 3), scatter=0.02)
    findings = findings_of(measure(sort_runs(find_runs([case])[0])))
    scopes = {finding.scope for finding in findings if finding.claim == "c"}
    assert scopes == {"all packs", "pack 1", "pack 2", "pack 3"}
    together = {finding.claim: finding for finding in findings if finding.scope == "all packs"}
    assert together["b, strain"].verdict == "reproduced" and together["d"].figure.startswith("holds on 3 of 3 packs")
    assert together["c"].verdict == "not reproduced"  # the shift between cases is the same on every pack, and larger than the uncertainty


def test_quasi_static_figures(tmp_path: Path) -> None:
    directory = synthetic.write_run(tmp_path, synthetic.Synthetic(samples=50))
    table = pd.read_csv(directory / "history.csv")
    table.loc[30, "sigma_v_Pa"] = 1.2e7
    table.to_csv(directory / "history.csv", index=False)
    row = run_table(measure(sort_runs(find_runs([directory])[0]))).iloc[0]
    assert row["largest_sigma_v_error"] == pytest.approx(0.2) and row["largest_wall_difference"] == pytest.approx(0.01 / 1.005)


def test_scatter_over_packs(tmp_path: Path) -> None:
    variants = measure(sort_runs(find_runs([synthetic.write_case(tmp_path / "case", seeds=(1, 2, 3), scatter=0.03)])[0]))
    scatter = scatter_table(variants).set_index("case")
    assert list(scatter["packs_that_slip"]) == [3] * 5
    for number, onset in synthetic.ONSETS.items():
        assert scatter.loc[number, "strain_mean"] == pytest.approx(onset, rel=0.01)
        assert scatter.loc[number, "strain_sd"] == pytest.approx(0.03 * onset, rel=0.15)
    table = run_table(variants)
    assert len(table) == 15 and table["directory"].is_unique


def test_shift_between_variants(tmp_path: Path) -> None:
    first = write_onsets(tmp_path / "a", {1: 1.08e-3, 5: 1.87e-3})
    second = write_onsets(tmp_path / "b", {1: 1.10e-3, 5: 2.3e-3}, strain_rate=0.78)
    shifts = variant_shifts(measure(sort_runs(find_runs([first, second])[0]))).set_index("case")
    assert shifts.loc[1, "strain_shift"] == pytest.approx(2e-5, rel=0.2) and shifts.loc[1, "strain_shift_over_uncertainty"] < 1.0
    assert shifts.loc[5, "strain_shift_over_uncertainty"] > 1.0


@pytest.mark.parametrize("onsets, verdict", [
    ({2: 1.2e-3, 3: 1.2e-3, 4: None}, "reproduced"), ({2: 1.2e-3, 3: 1.2e-3, 4: 1.5e-3}, "not reproduced"),
    ({2: None, 3: 1.2e-3, 4: None}, "not reproduced"),
    ({2: 1.2e-3, 3: 1.2e-3}, "not tested"),
])
def test_supplement(tmp_path: Path, onsets: dict, verdict: str) -> None:
    assert verdicts(write_onsets(tmp_path, onsets, scene="supplement"))["h"] == verdict


def test_the_page_holds_what_it_should(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = synthetic.write_case(tmp_path / "case", grains=300, samples=80)
    history = case / "case3-seed1" / "history.csv"
    history.write_bytes(history.read_bytes()[:-7])
    upright = write_onsets(tmp_path / "upright", {2: 1.2e-3, 3: 1.2e-3, 4: None}, scene="supplement", samples=80)
    assert main([str(case), str(upright), "--dpi", "50"]) == 0
    shown = capsys.readouterr()
    assert "(h)" in shown.out and "torn" in shown.err
    plots = case / "plots"
    page = (plots / "page.html").read_text()
    for words in ("not reproduced", "torn", "Quasi-static check", f"poreslip plot {case}", "Figures", "0.01 d"):
        assert words in page
    pictures = [part.split('"')[0] for part in page.split('<img src="')[1:]]
    assert len(pictures) == 8 + 4 and all((plots / name).stat().st_size > 3000 for name in pictures)
    assert not any("strain-rate" in name for name in pictures if name.startswith("variant-2"))
