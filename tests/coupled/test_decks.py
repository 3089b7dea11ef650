"""Decks that a user changes: what is added works, and what is wrong is told with the deck and the command, on one rank and on two."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from processes import the_message
from tiny_fault import history

SEVERAL = pytest.param(2, marks=pytest.mark.parallel)


def change(deck: Path, pattern: str, replacement: str) -> None:
    """Replace what a pattern finds in a deck, once."""
    text, count = re.subn(pattern, lambda _: replacement, deck.read_text(), count=1, flags=re.MULTILINE)
    assert count == 1, (deck, pattern)
    deck.write_text(text)


def append(deck: Path, *lines: str) -> None:
    deck.write_text(deck.read_text() + "\n".join(lines) + "\n")


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_additions_work(run_fault, own_decks, tmp_path, ranks):
    """A compute, a thermo column and a dump of the user's own, and the same run as without them."""
    dump = tmp_path / "grains.dump"
    append(
        own_decks / "in.load",
        "compute spin all erotate/sphere",
        "thermo_style custom step atoms ke c_spin",
        "thermo 100",
        f"dump mine all custom 200 {dump} id type x y z radius",
    )
    mine = run_fault(f"decks_directory={own_decks}", out="mine", ranks=ranks)
    plain = run_fault(out="plain", ranks=ranks)
    assert (mine / "history.csv").read_bytes() == (plain / "history.csv").read_bytes()
    # At the start of loading, at 200, and none later.
    assert dump.read_text().count("ITEM: TIMESTEP") >= 2
    assert "spin" in (mine / "log.liggghts").read_text()


def test_remarks_in_any_encoding(run_fault, own_decks):
    for name in ("in.load", "in.bond"):
        (own_decks / name).write_bytes((own_decks / name).read_bytes() + "# \u00fcber".encode("latin-1") + b"\n")
    run_fault(f"decks_directory={own_decks}", "loading.deck_variables.servo_gain=0.7", options=("--checkpoint-every", "100"))


def test_a_time_step_and_a_motion_of_the_decks_own_are_told(poreslip, tiny_case, own_decks, stage_cache, tmp_path):
    """The case's number of steps, and its limits, are of the case's step."""
    append(own_decks / "in.load", "timestep 1e-8", "unfix move", "fix move all nve")
    command = ["run", tiny_case, "--only", "dry", "--out", tmp_path / "out", "--set", f"decks_directory={own_decks}"]
    done = poreslip(*command, env={"PORESLIP_CACHE": str(stage_cache)})
    assert done.returncode == 0 and done.stdout.count("in.load sets a time step of 1e-08 s, 0.0989 times the case's: its 396 steps last 3.96e-06 s") == 1, done.stdout
    assert done.stdout.count("in.load moves grains by fix move (nve), which never turns them") == 1, done.stdout


def test_a_variable_of_the_deck_is_set_from_the_case(run_fault, own_decks):
    append(own_decks / "in.load", "variable extra_damping index 0.", "fix extra all viscous ${extra_damping}")
    without = history(run_fault(f"decks_directory={own_decks}", out="without"))
    damped = history(run_fault(f"decks_directory={own_decks}", "loading.deck_variables.extra_damping=100.0", out="damped"))
    assert damped["kinetic_energy_J"][-1] < 0.5 * without["kinetic_energy_J"][-1]


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_dumps_of_two_runs_lie_in_their_own_directories(run_fault, own_decks, stage_cache, ranks):
    """And those of a stage beside it."""
    append(own_decks / "in.load", "dump mine all custom 200 ${results}/grains.*.dump id x y z")
    append(own_decks / "in.bond", "write_dump all custom ${results}/bonded.dump id x y z")
    runs = [run_fault(f"decks_directory={own_decks}", run=name, ranks=ranks) for name in ("wet", "dry")]
    first, second = ([(run / f"grains.{step}.dump").read_text() for step in (0, 200)] for run in runs)
    assert first[0] == second[0] and first[1] != second[1]
    assert len(list(stage_cache.glob("bond-*/bonded.dump"))) == 1


def test_a_blank_in_the_path_of_results_matters_to_decks_that_ask_for_it(run_fault, failing_fault, poreslip, tiny_case, own_decks, stage_cache, tmp_path):
    run_fault(run="dry", out="my results")
    append(own_decks / "in.load", "dump mine all custom 200 ${results}/grains.*.dump id x y z")
    command = ["run", tiny_case, "--only", "dry", "--out", tmp_path / "my results", "--set", f"decks_directory={own_decks}"]
    assert "holds a blank, which LIGGGHTS cannot read" in the_message(poreslip(*command, env={"PORESLIP_CACHE": str(stage_cache)}), 2)


def test_a_changed_stage_is_made_anew(run_fault, own_decks, stage_cache):
    run_fault(run="dry", out="plain")
    before = set(stage_cache.iterdir())
    run_fault(f"decks_directory={own_decks}", run="dry", out="copied")
    assert set(stage_cache.iterdir()) == before, "the same decks in another place make the same stages"
    append(own_decks / "in.bond", "# another remark")
    run_fault(f"decks_directory={own_decks}", run="dry", out="changed")
    assert [path.name.split("-")[0] for path in set(stage_cache.iterdir()) - before] == ["bond"]


def test_a_relative_directory_starts_at_the_case_file(run_fault, tiny_case, own_decks):
    tiny_case.write_text(f'decks_directory = "{own_decks.name}"\n' + tiny_case.read_text())
    append(own_decks / "in.load", "print 'from my deck'")
    assert "from my deck" in (run_fault(run="dry") / "log.liggghts").read_text()


def test_forces_of_the_decks_own_do_work_that_is_not_taken_for_instability(poreslip, tiny_case, own_decks, stage_cache, tmp_path):
    """Of all that the deck has, the two fixes that are not its own from the start are named."""
    append(own_decks / "in.load", "fix push gouge addforce 0. 0. 5.", "fix weight all gravity 9.81 vector 0. 0. -1.", "fix mean all ave/time 10 1 10 f_x_left[1]")
    command = ["run", tiny_case, "--only", "wet", "--out", tmp_path / "out", "--set", f"decks_directory={own_decks}"]
    done = poreslip(*command, env={"PORESLIP_CACHE": str(stage_cache)})
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("this is the work of fix push (addforce), fix weight (gravity), which is not counted, or the motion is unstable") == 1, done.stdout


def test_walls_of_the_decks_own_speed_are_told_of(run_fault, own_decks):
    change(own_decks / "in.load", r"^fix_modify +x_left .*\n", "")
    run = run_fault(f"decks_directory={own_decks}", "bonds.strength_mean_Pa=1e9", run="wet")
    ended = json.loads((run / "report.json").read_text())["ended"]
    assert ended.startswith("the end of loading, at a strain of 0.0001 where the case has 0.0002") and ended.endswith("reached 50 % of their targets")


def test_energy_of_contacts_of_several_stiffnesses(run_fault, own_decks):
    """Stiffer blocks: no energy comes from nothing."""
    change(own_decks / "contacts.include", r"^fix +kn .*", "variable stiff equal 4*${kn}\n"
           "fix kn all property/global kn peratomtypepair 3 ${stiff} ${kn} ${kn} ${kn} ${kn} ${kn} ${kn} ${kn} ${stiff}")  # fmt: skip
    slow = ("loading.horizontal_strain=2e-5", "loading.strain_rate_per_s=0.2", "loading.time_step_fraction=0.25", "bonds.strength_mean_Pa=1e9")
    run = run_fault(f"decks_directory={own_decks}", *slow, run="dry")
    checks = json.loads((run / "report.json").read_text())["quasi_static_checks"]
    assert checks["energy_gain"] < 1e-9, checks


LOAD, STRESS, PACK = "in.load", "in.stress", "in.pack"
#: What is done to which deck, and what the message then names.
BAD = {
    "unknown command": (LOAD, lambda d: append(d, "shear the_fault now"), ["Unknown command: shear the_fault now", "{deck}"]),
    "unknown fix": (LOAD, lambda d: append(d, "fix pull all pulling 3"), ["Invalid fix style", "fix pull all pulling 3", "{deck}"]),
    "unknown compute": (LOAD, lambda d: append(d, "compute c all no/such"), ["compute c all no/such", "{deck}"]),
    "unset variable": (LOAD, lambda d: append(d, "timestep ${no_such}"), ["no_such", "{deck}"]),
    "no wall": (LOAD, lambda d: append(d, "unfix z_top_left"), ["{deck} defines no `fix z_top_left ... wall/plane`"]),
    "no group": (LOAD, lambda d: append(d, "unfix hold_ends", "group gouge_ends delete"), ["{deck} defines no `group gouge_ends`"]),
    "no reference position": (
        LOAD, lambda d: change(d, r"^fix +reference_position .*\n", ""), ["{deck} defines no `fix reference_position`", "property/atom"]),
    "no pore force": (LOAD, lambda d: change(d, r"^include .*pore_force_.*\n", ""), ["{deck} defines no `fix pore_force`", "pore_force_${{pore_force}}.include"]),
    "pore force of no effect": (LOAD, lambda d: append(d, "unfix add_pore_force"), ["{deck} defines no `fix add_pore_force`"]),
    "no bonds": (LOAD, lambda d: append(d, "unfix bonds"), ["{deck} defines no `fix bonds`", "bond/settings armed no"]),
    "no motion": (LOAD, lambda d: append(d, "unfix move"), ["{deck} lets 465 of 465 grains stand still", "`fix move all nve/sphere`"]),
    "motion of the gouge alone": (LOAD, lambda d: append(d, "unfix move", "fix move gouge nve/sphere"), ["of 465 grains stand still", "fix freeze"]),
    "no motion in the stress": (STRESS, lambda d: change(d, r"^fix +move .*\n", ""), ["{deck} lets", "`fix move all nve/sphere`"]),
    "no motion in the pack": (PACK, lambda d: change(d, r"^fix +move .*\n", ""), ["{deck} lets", "stand still"]),
    "no step": (LOAD, lambda d: append(d, "timestep 0."), ["{deck} sets a time step of 0 s", "above 0"]),
    "quit": (LOAD, lambda d: append(d, "quit"), ["the deck ends the engine", "quit", "{deck}"]),
    "other springs": (
        PACK, lambda d: change(d.with_name("contacts.include"), "hooke/stiffness tangential .*", "hertz/stiffness tangential history"),
        ["{deck} has contacts of a model that the driver cannot read forces of", "hooke/stiffness tangential history"]),
    "no memory of the shear": (
        PACK, lambda d: change(d.with_name("contacts.include"), r"tangential \$.tangential.", "tangential no_history"), ["{deck} has contacts of a model"]),
    "no such include": (LOAD, lambda d: append(d, "include ${inputs}/absent.include"), ["absent.include", "{deck}"]),
    "wrong servo": (LOAD, lambda d: append(d, "fix_modify x_left servo strain 1 area 1"), ["fix_modify x_left servo strain 1 area 1", "{deck}"]),
    "wrong damping": (LOAD, lambda d: append(d, "fix again all damping/local 1.5"), ["fix again all damping/local 1.5", "{deck}"]),
    "wrong wall": (
        LOAD, lambda d: append(d, "fix w all wall/plane normal 1 1 0 position 0. kn 1e7 velocity 0."), ["fix w all wall/plane normal 1 1 0", "{deck}"]),
    "wrong pore force": (LOAD, lambda d: append(d, "fix again all poreforce no_such"), ["no_such", "{deck}"]),
    "no pair style": (STRESS, lambda d: change(d, r"^include .*contacts.include\n", ""), ["{deck}"]),
    "grains lost in loading": (
        LOAD, lambda d: append(d, "velocity all set 2e6 0. 0.", "run 50"), ["grains were lost by step", "loading.time_step_fraction", "{deck}"]),
    "grains lost in the stress": (
        STRESS, lambda d: append(d, "velocity right set 2e6 0. 0.", "run 50"), ["grains were lost by step", "{deck}"]),
    "no such deck": (PACK, lambda d: d.unlink(), ["the deck {deck} does not exist", "copy all of liggghts-inputs"]),
    "no such second deck": (PACK, lambda d: d.with_name("in.pack_release").unlink(), ["in.pack_release does not exist"]),
}  # fmt: skip


def expected(name: str, own_decks: Path) -> tuple[int, list[str]]:
    """Exit status, and parts of the message."""
    deck, _, parts = BAD[name]
    return 3 if "lost" in name else 2, [part.format(deck=own_decks / deck) for part in parts]


@pytest.mark.parametrize("name", BAD)
def test_bad_deck(failing_fault, own_decks, name):
    BAD[name][1](own_decks / BAD[name][0])
    status, parts = expected(name, own_decks)
    message = failing_fault(f"decks_directory={own_decks}", run="wet", status=status)
    for part in parts:
        assert part in message


@pytest.mark.parallel
@pytest.mark.parametrize("name", ["unknown fix", "no wall", "quit", "other springs", "no step", "no motion", "no motion in the pack", "no such include", "wrong servo", "no pore force", "grains lost in loading", "no such deck"])
def test_bad_deck_on_two_ranks(failing_fault, own_decks, name):
    """A file that is not there is seen by the first rank alone, while the others wait in the engine: it ends them."""
    BAD[name][1](own_decks / BAD[name][0])
    status, parts = expected(name, own_decks)
    message = failing_fault(f"decks_directory={own_decks}", run="wet", status=status, ranks=2, together=name != "no such include")
    for part in parts:
        assert part in message


def test_no_such_directory(failing_fault, tmp_path):
    message = failing_fault(f"decks_directory={tmp_path}/absent")
    assert f"there is no directory {tmp_path}/absent. Copy liggghts-inputs" in message


@pytest.mark.parametrize("value", ["3", '""'])
def test_no_path(failing_fault, value):
    assert "decks_directory = " in (message := failing_fault(f"decks_directory={value}")) and "allowed is a path in quotes" in message


def test_a_path_with_a_blank(poreslip, tiny_case, tmp_path):
    message = the_message(poreslip("run", tiny_case, "--only", "dry", "--out", tmp_path / "out", env={"PORESLIP_CACHE": str(tmp_path / "my cache")}), 2)
    assert "holds a blank, which LIGGGHTS cannot read" in message
