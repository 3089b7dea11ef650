"""Study files: what they say, and that a wrong one ends with one message that tells what to correct."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from coupling.case.files import load_case
from coupling.errors import InputError
from coupling.native import REPOSITORY
from coupling.study.files import load_study
from coupling.study.plan import Plan, toml

CASE = 'scene = "two_sides"\npressure.left_target_Pa = 1e7\n[[run]]\nname = "wet"\n[[run]]\nname = "dry"\npressure.mode = "none"\npressure.left_target_Pa = 0.0\n'
STUDY = """\
title = "Rate"
tolerance = 0.05

[run]
case = "fault.toml"
only = "dry"
set = { "pack.seed" = 3 }

[[parameter]]
key = "loading.strain_rate_per_s"
values = [1.0, 2.0]

[observable]
name = "history"
column = "sigma_n_Pa"

[reference]
settings = { "loading.strain_rate_per_s" = 0.5 }
"""


@pytest.fixture
def study(tmp_path: Path):
    """`study(old="", new="", text=STUDY)`: path of a study file with one part replaced."""
    (tmp_path / "fault.toml").write_text(CASE)
    (tmp_path / "box.toml").write_text('scene = "sample"\nflow.kind = "none"\n')

    def write(old: str = "", new: str = "", text: str = STUDY) -> Path:
        assert old in text
        path = tmp_path / "rate.toml"
        path.write_text(text.replace(old, new, 1) if old else text)
        return path

    return write


def test_settings_and_reference(study):
    path = study("[observable]", '[[parameter]]\nkey = "pack.seed"\nvalues = [1, 2]\nspread = true\n\n[observable]')
    plan = Plan(load_study(path))
    assert [tuple(setting.options.values()) for setting in plan.settings] == [(1.0, 1), (1.0, 2), (2.0, 1), (2.0, 2)]
    assert len(plan.references) == 2
    # A pack is held against its own reference.
    for setting in plan.settings:
        assert plan.reference_of(setting).options == {"pack.seed": setting.options["pack.seed"], "loading.strain_rate_per_s": 0.5}
    arguments = plan.settings[0].jobs["run"].arguments
    assert "pack.seed=1" in arguments and "--only=dry" in arguments and plan.settings[0].jobs["run"].results == "fault/dry"


def test_what_decides_a_result_decides_its_run(study, tmp_path):
    digest = lambda: Plan(load_study(tmp_path / "rate.toml")).settings[0].jobs["run"].digest  # noqa: E731
    study()
    first = digest()
    study('title = "Rate"', 'title = "Another title"')
    assert digest() == first
    study("pack.seed\" = 3", "pack.seed\" = 4")
    assert digest() != first
    study()
    (tmp_path / "fault.toml").write_text(CASE.replace("1e7", "2e7"))
    assert digest() == first  # the dry run does not take it
    (tmp_path / "fault.toml").write_text("material.friction = 0.4\n" + CASE)
    assert digest() != first


def test_a_companion_keeps_what_it_sets_and_takes_the_rest(study):
    companion = '[companion.slow]\ncase = "fault.toml"\nonly = "wet"\nset = { loading.strain_rate_per_s = 0.1 }\n'
    seeds = '[[parameter]]\nkey = "pack.seed"\nvalues = [7]\n'
    text = STUDY.replace("[observable]", f"{companion}\n{seeds}\n[observable]").replace("= 0.5 }", '= 0.5, "pack.seed" = 7 }')
    arguments = Plan(load_study(study(text=text))).settings[0].jobs["slow"].arguments
    assert "loading.strain_rate_per_s=0.1" in arguments and "pack.seed=7" in arguments
    limited = text.replace('only = "wet"', 'only = "wet"\nparameters = ["loading.strain_rate_per_s"]')
    arguments = Plan(load_study(study(text=limited))).settings[0].jobs["slow"].arguments
    assert not any("pack.seed" in argument for argument in arguments)


def test_choices_change_together(study):
    text = STUDY.replace('key = "loading.strain_rate_per_s"\nvalues = [1.0, 2.0]', """key = "rate"
[parameter.choices]
slow = { loading.strain_rate_per_s = 1.0, output.history_interval_steps = 200 }
fast = { "loading.strain_rate_per_s" = 4.0 }""").replace('"loading.strain_rate_per_s" = 0.5', 'rate = "slow"')
    plan = Plan(load_study(study(text=text)))
    slow, fast = plan.settings
    assert slow.options == {"rate": "slow"} and slow.inputs == {"loading.strain_rate_per_s": 1.0, "output.history_interval_steps": 200}
    assert "output.history_interval_steps=200" in slow.jobs["run"].arguments and "loading.strain_rate_per_s=4.0" in fast.jobs["run"].arguments
    assert plan.reference_of(fast).jobs == slow.jobs


def test_a_value_that_the_case_refuses_is_a_setting_with_a_reason(study):
    plan = Plan(load_study(study("[1.0, 2.0]", "[-1.0, 2.0]")))
    assert "allowed is a finite number, above 0" in plan.settings[0].jobs["run"].refused
    assert plan.settings[1].jobs["run"].refused == ""


def test_values_as_toml():
    assert toml({"z_top": "stress 1e7", "n": [1, 0.1], "on": True}) == '{ z_top = "stress 1e7", n = [1, 0.1], on = true }'
    assert float(toml(1 / 3)) == 1 / 3


REFUSED = {
    "unknown key": ("tolerance = 0.05", "tolerence = 0.05", "unknown key tolerence.*did you mean tolerance"),
    "no tolerance": ("tolerance = 0.05", "", "tolerance is missing"),
    "tolerance of 0": ("tolerance = 0.05", "tolerance = 0.0", "tolerance = 0: allowed is a number above 0"),
    "tolerance in words": ("tolerance = 0.05", 'tolerance = "small"', "tolerance = 'small': allowed is a finite number"),
    "not TOML": ("[run]", "[run", "not valid TOML"),
    "no such case": ("fault.toml", "faults.toml", "there is no file .*faults.toml.*did you mean fault.toml"),
    "case and flow": ('only = "dry"', 'poreflow = "pack.txt"', "either a case file"),
    "no such run": ('only = "dry"', 'only = "drye"', "no run of that name.*did you mean dry"),
    "several runs": ('only = "dry"\n', "", "stands for 2 runs .wet, dry."),
    "unknown key in run": ('only = "dry"', 'onyl = "dry"', r"unknown key onyl in \[run\].*did you mean only"),
    "wrong kind": ('only = "dry"', "only = 3", "only = 3 in run: allowed is text"),
    "ranks": ('only = "dry"', 'only = "dry"\nranks = 0', "ranks = 0"),
    "unknown input": ('"pack.seed" = 3', '"pack.sead" = 3', "pack.sead.*no input of a case.*did you mean pack.seed"),
    "unknown parameter": ("loading.strain_rate_per_s", "loading.strain_rate", "lacks the parameter|no input of a case.*did you mean loading.strain_rate_per_s"),
    "no values": ("values = [1.0, 2.0]", "values = []", "needs either values"),
    "one value": ("values = [1.0, 2.0]", "values = 1.0", "values = 1.0 in parameter 1: allowed is a list"),
    "a value twice": ("values = [1.0, 2.0]", "values = [1.0, 1.0]", "names a value twice"),
    "no key": ('key = "loading.strain_rate_per_s"\n', "", "key is missing in parameter 1"),
    "all spread": ("values = [1.0, 2.0]", "values = [1.0, 2.0]\nspread = true", "there are 0 parameters"),
    "unknown observable": ('name = "history"', 'name = "histroy"', "observable histroy is not known.*did you mean history"),
    "no column": ('column = "sigma_n_Pa"\n', "", "needs the name of a column"),
    "two references": ("[reference]", "[reference]\nvalue = 1.0", "needs one of settings, value, analytic and file; given are settings, value"),
    "no reference": ('settings = { "loading.strain_rate_per_s" = 0.5 }', "", "given is none"),
    "unknown solution": ('settings = { "loading.strain_rate_per_s" = 0.5 }', 'analytic = "terzagi"', "terzagi is not known.*did you mean terzaghi"),
    "no reference file": ('settings = { "loading.strain_rate_per_s" = 0.5 }', 'file = "no.csv"', "there is no reference file"),
    "argument of no observable": ('name = "history"\ncolumn = "sigma_n_Pa"', 'name = "slip"\narguments = { sied = "left" }', "slip has no argument sied.*did you mean side.*: side, at"),
    "argument of another kind": ('name = "history"\ncolumn = "sigma_n_Pa"', 'name = "slip"\narguments = { side = 3 }', "side = 3 in the arguments of slip: allowed is text"),
    "place without a number": ('name = "history"\ncolumn = "sigma_n_Pa"', 'name = "slip"\narguments = { at = { strain = "a" } }', "at = .* of slip: allowed is one column and its value"),
    "missing argument": ('name = "history"\ncolumn = "sigma_n_Pa"', 'name = "amplitude"', "amplitude needs arguments = { wave_length_m = "),
    "column of another observable": ('name = "history"', 'name = "onset"', "onset takes no column"),
    "missing argument of a solution": ('settings = { "loading.strain_rate_per_s" = 0.5 }', 'analytic = "kozeny_carman"', "kozeny_carman needs arguments = { diameter_m"),
    "curve against a number": ('column = "sigma_n_Pa"\n\n[reference]\nsettings = { "loading.strain_rate_per_s" = 0.5 }',
                               'column = "sigma_n_Pa"\nover = "strain"\n\n[reference]\nvalue = 1.0', "value is one number, and the observable is a curve"),
    "error relative to 0": ('settings = { "loading.strain_rate_per_s" = 0.5 }', "value = 0.0", "value = 0: set relative = false"),
    "empty command": ('case = "fault.toml"\nonly = "dry"\nset = { "pack.seed" = 3 }', 'poreflow = " "', "allowed is the command line of poreflow"),
    "quote without its other": ('case = "fault.toml"\nonly = "dry"\nset = { "pack.seed" = 3 }', 'poreflow = "fault.toml \'--dt"', "with quotes in pairs"),
    "no companion": ('name = "history"\ncolumn = "sigma_n_Pa"', 'name = "consolidation"', r"observable consolidation needs \[companion.dry\], a run of its own"),
    "no companions of a solution": ('column = "sigma_n_Pa"\n\n[reference]\nsettings = { "loading.strain_rate_per_s" = 0.5 }',
                                    'column = "sigma_n_Pa"\nover = "strain"\n\n[reference]\nanalytic = "terzaghi"', r"terzaghi needs \[companion.dry\] and \[companion.darcy\]"),
    "column of no history": ('column = "sigma_n_Pa"', 'column = "sigma_m_Pa"', "rate: column = .sigma_m_Pa. in .observable.: history.csv of the run loading.strain_rate_per_s = 0.5 will have "
                             "no such column .did you mean sigma_._Pa..; write one of its columns: step, .*kinetic_energy_J"),
    "column to read over": ('column = "sigma_n_Pa"', 'column = "sigma_n_Pa"\nover = "time"', 'over = "time" in .observable.: .*did you mean time_s'),
    "column to read at": ('column = "sigma_n_Pa"', 'column = "sigma_n_Pa"\nat = { strian = 1e-3 }', "at = { strian = 0.001 } in .observable.: .*did you mean strain"),
    "column of an argument": ('name = "history"\ncolumn = "sigma_n_Pa"', 'name = "slip"\narguments = { at = { strian = 1e-3 } }', "at = { strian = 0.001 } in .observable.: .*did you mean strain"),
    "column of a solved flow": ('column = "sigma_n_Pa"', 'column = "pressure_mean_Pa"', "pressure_mean_Pa.*will have no such column"),
    "lacking parameter": ('settings = { "loading.strain_rate_per_s" = 0.5 }', 'settings = { "pack.seed" = 2 }', "lacks the parameter loading.strain_rate_per_s"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(study, name):
    old, new, message = REFUSED[name]
    with pytest.raises(InputError) as refused:
        Plan(load_study(study(old, new)))
    assert re.search(message, str(refused.value), re.DOTALL), str(refused.value)


OTHER_RUN = """\
tolerance = 0.05
[run]
{}
[[parameter]]
key = "{}"
values = [1, 2]
[observable]
name = "{}"
{}
[reference]
value = 1.0
"""


@pytest.mark.parametrize(("text", "message"), [
    (OTHER_RUN.format('case = "box.toml"', "pack.seed", "slip", ""), "observable slip reads slip_left_m, slip_right_m, which history.csv of the run pack.seed = 1 will not have"),
    (OTHER_RUN.format('case = "box.toml"', "pack.seed", "history", 'column = "slip_left_m"'), "slip_left_m.*write one of its columns: .*porosity"),
    (OTHER_RUN.format('poreflow = "box.toml --box 0 1 0 1 0 1"', "--dt", "history", 'column = "strain"'), "history is read from history.csv, which poreflow does not write"),
    (OTHER_RUN.format('poreflow = "box.toml --box 0 1 0 1 0 1"', "--dt", "pressures", "").replace("value = 1.0", 'file = "fault.toml"'), "pressures is not one number, and .reference. file = "),
    # A flow that is not solved has no such column, though the other setting has.
    (OTHER_RUN.format('case = "fault.toml"\nonly = "wet"', "kind", "history", 'column = "pressure_mean_Pa"').replace(
        "values = [1, 2]", 'choices.solved = { "flow.kind" = "solve" }\nchoices.given = { "flow.kind" = "prescribed" }'), "history.csv of the run kind = given will have no such column"),
])  # fmt: skip
def test_refused_of_other_runs(study, text, message):
    with pytest.raises(InputError) as refused:
        Plan(load_study(study(text=text)))
    assert re.search(message, str(refused.value), re.DOTALL), str(refused.value)


def test_a_study_is_no_case_and_a_case_no_study(study):
    path = study()
    with pytest.raises(InputError, match="rate.toml is a study file; carry it out with `poreslip study "):
        load_case(path)
    with pytest.raises(InputError, match="fault.toml is a case file; carry it out with `poreslip run "):
        load_study(path.with_name("fault.toml"))


def test_no_file_and_a_near_one(study):
    path = study()
    with pytest.raises(InputError, match="there is no study file.*did you mean.*rate.toml"):
        load_study(path.with_name("rates.toml"))


@pytest.mark.parametrize("path", sorted((REPOSITORY / "cases" / "studies").glob("*.toml")), ids=lambda path: path.stem)
def test_studies_that_ship_can_be_carried_out(path):
    plan = Plan(load_study(path))
    refused = [setting for setting in plan.settings if setting.jobs["run"].refused]
    assert len(refused) <= len(plan.settings) // 2
