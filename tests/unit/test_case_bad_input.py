"""Case files that are wrong: each kind is refused with one message that names the place and what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from coupling.case.files import load_case, run_case_from_dict, select_runs
from coupling.errors import InputError

HEAD = 'scene = "two_sides"\npressure.left_target_Pa = 1e7\n'

BAD_FILES = {
    "unknown section": ("[pak]\nseed = 1\n", ["line 3", "unknown key pak", "did you mean pack?"]),
    "unknown key": ("[pack]\nporosty = 0.4\n", ["line 4", "unknown key pack.porosty", "did you mean porosity?", "box_m"]),
    "unknown key in a run": ('[[run]]\nname = "a"\nflow.force = "total"\n', ["line 5", "unknown key flow.force", "did you mean forces?"]),
    "unknown section in a run": ('[[run]]\nname = "a"\nflw.forces = "total"\n', ["unknown key flw", "did you mean flow?"]),
    "unknown key of the sweep": ("[sweep]\nseed = [1]\n", ["sweep.seed", "did you mean seeds?"]),
    "malformed": ("[pack\nseed = 1\n", ["not valid TOML", "line 3"]),
    "key given twice": ("[pack]\nseed = 1\nseed = 2\n", ["not valid TOML", "line 5"]),
    "text for a number": ('[pack]\nporosity = "0.4"\n', ["line 4", 'pack.porosity = "0.4"', "a finite number, at least 0.2 and at most 0.9", "default is 0.35"]),
    "truth value for a number": ("[material]\nfriction = true\n", ["material.friction = true", "a finite number"]),
    "number for a truth value": ("[bonds]\nenabled = 1\n", ["bonds.enabled = 1", "true or false"]),
    "fraction for a count": ("[pack]\nseed = 1.5\n", ["pack.seed = 1.5", "a whole number"]),
    "number for text": ("[flow]\nforces = 2\n", ["flow.forces = 2", '"total", "pressure"']),
    "not a number": ("[material]\nfriction = nan\n", ["material.friction = nan", "a finite number"]),
    "infinite": ("[loading]\nvertical_stress_Pa = inf\n", ["loading.vertical_stress_Pa = inf", "a finite number"]),
    "negative": ("[material]\nmodulus_Pa = -5e10\n", ["line 4", "material.modulus_Pa = -5e+10", "above 0"]),
    "one of several out of range": ("[pack]\nbox_m = [0.08, 0.0, 0.05]\n", ["pack.box_m = [0.08, 0, 0.05]", "three finite numbers, [x, y, z], above 0"]),
    "too few values": ("[pack]\nbox_m = [0.08, 0.02]\n", ["pack.box_m = [0.08, 0.02]", "three finite numbers"]),
    "value for a section": ("pack = 3\n", ["pack = 3", "[pack]"]),
    "table for a value": ("[pack.seed]\nfirst = 1\n", ["pack.seed", "a whole number"]),
    "bad deck variable": ("[pack.deck_variables]\ndrag = [1, 2]\n", ["pack.deck_variables", "a table of numbers and texts"]),
    "deck variable with a bad name": ('[pack.deck_variables]\n"two words" = 1\n', ["pack.deck_variables", "a table of numbers and texts"]),
    "variable that the deck has not": ("[pack.deck_variables]\ndrg = 1\n", ["pack.deck_variables", "in.pack", " drag,"]),
    "unknown engine": ('engine = "ligghts"\n', ['engine = "ligghts"', "did you mean liggghts?"]),
    "title that is no text": ("title = 3\n", ["title = 3", "text in quotes"]),
    "faces of a fault's flow": ('[flow]\nkind = "solve"\n[fluid]\nfaces = { xmin = 0.0 }\n', ["fluid.faces", "has no effect in the scene", "fluid.held"]),
    "diameters swapped": ("[pack]\ndiameter_m = [2.2e-3, 1.8e-3]\n", ["pack.diameter_m", "swap them"]),
    "box too small": ("[pack]\nbox_m = [0.08, 0.001, 0.05]\n", ["pack.box_m", "three of the largest grains"]),
    "more grains than can be numbered": ("[pack]\ndiameter_m = [1e-6, 1e-6]\n", ["pack.diameter_m", "grains"]),
    "gouge wider than the box": ("[fault]\ngouge_width_m = 0.2\n", ["fault.gouge_width_m", "narrow the gouge"]),
    "gouge that leaves no strip of the blocks": ("[fault]\ngouge_width_m = 0.016\n", ["fault.gouge_width_m", "reaches 0.0363137 m"]),
    "gouge of one grain": ("[fault]\ngouge_width_m = 0.003\n", ["fault.gouge_width_m", "two of the largest grains"]),
    "dip that leaves by the sides": ("[fault]\ndip_degrees = 20\n", ["fault.gouge_width_m", "raise fault.dip_degrees"]),
    "upright fault compressed": ("[fault]\ndip_degrees = 90\n", ["fault.dip_degrees", "supplement"]),
    "end band too deep": ("[fault]\nend_band_m = 0.02\n", ["fault.end_band_m", "quarter"]),
    "strengths that scatter too far": ("[bonds]\nstrength_sd_Pa = 2e9\n", ["bonds.strength_sd_Pa", "mean"]),
    "loading in no time": ("[loading]\nstrain_rate_per_s = 1e6\n", ["loading.strain_rate_per_s", "too few", "lower it"]),
    "loading for ever": ("[loading]\nstrain_rate_per_s = 1e-8\n", ["loading.strain_rate_per_s", "raise it"]),
    "history between updates": ("[output]\nhistory_interval_steps = 30\n[flow]\ninterval_steps = 20\n", ["output.history_interval_steps = 30", "multiple", "40 is the nearest"]),
    "checkpoint between updates": ("[output]\ncheckpoint_every_steps = 1001\n", ["output.checkpoint_every_steps", "multiple", "1000 is the nearest"]),
    "history rarer than the run": ("[output]\nhistory_interval_steps = 1000000\n", ["output.history_interval_steps", "lower it"]),
    "more snapshots than steps": ("[output]\nsnapshots = 90000\n", ["output.snapshots", "lower it"]),
    "run without a name": ("[[run]]\npack.seed = 2\n", ["run 1 needs a name"]),
    "run with a path for a name": ('[[run]]\nname = "../case1"\n', ["needs a name", "../case1"]),
    "two runs of one name": ('[[run]]\nname = "a"\n[[run]]\nname = "a"\n', ["line 6", "two runs are named a"]),
    "run in single brackets": ('[run]\nname = "a"\n', ["[[run]]"]),
    "sweep over no seed": ("[sweep]\nseeds = []\n", ["line 4", "sweep.seeds = []"]),
    "sweep over a seed twice": ("[sweep]\nseeds = [1, 1]\n", ["sweep.seeds", "different"]),
    "sweep that is no table": ("sweep = 3\n", ["sweep = 3", "[sweep]"]),
}


@pytest.mark.parametrize(("text", "expected"), BAD_FILES.values(), ids=BAD_FILES.keys())
def test_a_bad_case_file_is_refused(tmp_path: Path, text: str, expected: list[str]) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(HEAD + text)
    with pytest.raises(InputError) as refusal:
        load_case(path)
    message = str(refusal.value)
    for part in [str(path), *expected]:
        assert part in message


BAD_OVERRIDES = {
    "no value": ("pack.seed", "section.key=value"),
    "empty value": ("pack.seed=", "section.key=value"),
    "no key": ("=3", "section.key=value"),
    "odd key": ("pack seed=3", "section.key=value"),
    "unknown key": ("pack.sed=3", "did you mean seed?"),
    "unknown section": ("pak.seed=3", "--set: unknown key pak (did you mean pack?)"),
    "section left out": ("seed=3", "--set: unknown key seed"),
    "unknown scene": ("scene=two_side", "did you mean two_sides?"),
    "text for a number": ("pack.seed=three", 'pack.seed = "three": allowed is a whole number'),
    "unknown choice": ("pressure.mode=linar", '"none", "uniform", "linear", "expression"'),
    "key below a value": ("pack.seed.first=3", "--set: pack.seed"),
    "section replaced": ("pack=3", "[pack]"),
    "a run": ("run.case1.pack.seed=3", "--only"),
    "forces of no pressure": ("flow.kind=none", "would act on no grain"),
    "one pressure that is two": ("pressure.mode=uniform", 'choose mode "linear"'),
    "pressure of zero": ("pressure.left_target_Pa=0", 'set pressure.mode = "none"'),
    "formula in another mode": ("pressure.expression=p_t", 'set pressure.mode = "expression"'),
    "a stress in MPa": ("loading.vertical_stress_Pa=10", "It is in Pa (1e7 is 10 MPa)"),
    "supplement with a dip": ("scene=supplement", "set it to 90"),
}


@pytest.mark.parametrize(("override", "expected"), BAD_OVERRIDES.values(), ids=BAD_OVERRIDES.keys())
def test_a_bad_override_is_refused(tmp_path: Path, override: str, expected: str) -> None:
    path = tmp_path / "good.toml"
    path.write_text(HEAD)
    with pytest.raises(InputError) as refusal:
        load_case(path, [override])
    assert expected in str(refusal.value)


BAD_FORMULAS = {
    "none": ("", "needs a formula"),
    "not a formula": ("p_left *", "is not a formula"),
    "unknown name": ("p_left * depth", "names depth"),
    "unknown function": ("tanhh(x)", "calls tanhh"),
    "an attribute": ("x.__class__", "cannot be evaluated"),
    "not a number somewhere": ("sqrt(s)", "yields nan at x = "),
    "infinite": ("p_t / strain", "yields inf at x = "),
    "a truth value": ("s < 0", "true or false"),
    "complex": ("x + 1j", "complex"),
    "a call without its argument": ("sin()", "cannot be evaluated"),
}


@pytest.mark.parametrize(("formula", "expected"), BAD_FORMULAS.values(), ids=BAD_FORMULAS.keys())
def test_a_bad_pressure_formula_is_refused(tmp_path: Path, formula: str, expected: str) -> None:
    path = tmp_path / "formula.toml"
    path.write_text(HEAD + f'pressure.mode = "expression"\npressure.expression = "{formula}"\n')
    with pytest.raises(InputError) as refusal:
        load_case(path)
    assert f"{path}, line 4: pressure.expression" in str(refusal.value)
    assert expected in str(refusal.value)


def test_the_scene_has_to_be_named(tmp_path: Path) -> None:
    path = tmp_path / "empty.toml"
    path.write_text("")
    with pytest.raises(InputError, match='scene = missing: allowed is one of "two_sides", "supplement"'):
        load_case(path)


def test_a_seed_cannot_be_set_against_a_sweep(tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(HEAD + "[sweep]\nseeds = [1, 2]\n")
    with pytest.raises(InputError, match="sweep.seeds"):
        load_case(path, ["pack.seed=3"])


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "quick.toml").write_text(HEAD)
    (tmp_path / "picture.toml").write_bytes(b"\x89PNG\r\n\xff\xfe")
    (tmp_path / "circle.toml").symlink_to(tmp_path / "circle.toml")
    for name, expected in {
        "quik.toml": "did you mean",
        "absent/case.toml": "there is no case file",
        ".": "is a directory",
        "picture.toml": "not a text file in UTF-8",
        "circle.toml": "cannot read",
        "quick.toml/case.toml": "cannot read",
    }.items():
        with pytest.raises(InputError, match=expected):
            load_case(tmp_path / name)


def test_a_run_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(HEAD + '[[run]]\nname = "case1"\n[[run]]\nname = "case2"\n')
    with pytest.raises(InputError, match=r"--only cse1: .*did you mean case1\?.*Its runs: case1, case2"):
        select_runs(load_case(path), ["cse1"])


def test_a_written_case_that_was_changed(tmp_path: Path) -> None:
    path = tmp_path / "good.toml"
    path.write_text(HEAD)
    resolved = load_case(path).runs[0].to_dict()
    with pytest.raises(InputError, match="the key 'group' is missing"):
        run_case_from_dict({key: value for key, value in resolved.items() if key != "group"}, "case.json")
    with pytest.raises(InputError, match="case.json: unknown key pack.sed"):
        run_case_from_dict(resolved | {"pack": {"sed": 1}}, "case.json")
    with pytest.raises(InputError, match="case.json: pack.seed = 0"):
        run_case_from_dict(resolved | {"pack": {"seed": 0}}, "case.json")
