"""Bad arguments of the styles are refused with a message that names keyword, value and what is allowed."""

from __future__ import annotations

import re

import pytest
from styles_scene import Grain, Scene, SceneError, run_scene

BOND = "fix b all bond/settings "
GOOD_BOND = BOND + "strength_mean 1e6 strength_sd 0 seed 1 types 1 1 armed yes"
WALL = "fix w all wall/plane normal 0 0 1 position 0 kn 1e6 "
PROPERTY = "fix pf all property/atom f_pf vector yes no no 0. 0. 0."

#: commands (the last one is at fault, or the run after it), and what the message has to say
BAD = [
    ([BOND + "armed maybe"], "armed is maybe, allowed: yes, no"),
    ([BOND + "armed yes strength_sd 0 seed 1 types 1 1"], "strength_mean is missing, allowed: 0 or more"),
    ([BOND + "armed yes strength_mean 1e6 strength_sd 0 seed 1"], "types is missing, allowed: pairs of atom types"),
    ([GOOD_BOND.replace("1e6", "-5")], "strength_mean is -5, allowed: 0 or more"),
    ([GOOD_BOND.replace("1e6", "1e6Pa")], "strength_mean is 1e6Pa, allowed"),
    ([GOOD_BOND.replace("strength_sd 0", "strength_sd nan")], "strength_sd is nan, allowed"),
    ([GOOD_BOND.replace("seed 1", "seed 1.5")], "seed is 1.5, allowed: a whole number from 0"),
    ([GOOD_BOND.replace("types 1 1", "types 1 4")], "types is 4, allowed: pairs of atom types from 1 to 3"),
    ([GOOD_BOND.replace("types 1 1", "types 1")], "types is armed, allowed: pairs of atom types"),
    ([GOOD_BOND + " strength 5"], "keyword is strength, allowed: strength_mean, strength_sd"),
    ([GOOD_BOND + " strength_floor 2e6"], "strength_floor is 2e\\+06, allowed: 0 to strength_mean"),
    ([GOOD_BOND + " gap 1e-3"], "gap is 0.001, allowed: 0 to 0.0001 .* stretch_max 0.05 of pair_style"),
    ([GOOD_BOND, GOOD_BOND.replace("fix b", "fix c")], "there is another fix bond/settings"),
    ([BOND + "armed no", "fix_modify b armed yes"], "armed is yes, but the fix was defined without types and strengths"),
    (["pair_style gran model hooke/stiffness tangential history", "pair_coeff * *", GOOD_BOND], "needs 'pair_style gran model hooke/stiffness tangential bond'"),
    (["pair_style gran model hooke/stiffness tangential bond stretch_max -1"], "stretch_max is -1, allowed: above 0 to 1"),
    (["fix w all wall/plane normal 0 1 1 position 0 kn 1e6 velocity 0"], "normal is 0 1 1, allowed: 1 0 0, -1 0 0"),
    (["fix w all wall/plane position 0 kn 1e6 velocity 0"], "normal is missing"),
    ([WALL], "velocity or servo is missing"),
    ([WALL.replace("kn 1e6", "kn 0") + "velocity 0"], "kn is 0, allowed: above 0"),
    ([WALL + "velocity fast"], "velocity is fast, allowed: a number"),
    ([WALL + "velocity 0 speed 3"], "keyword is speed, allowed: normal, position, kn"),
    ([WALL + "velocity 0 servo stress 1 area 1 gain 1 vmax 1"], "give either velocity or servo, once"),
    ([WALL + "servo stress 1e6 area -2 gain 0.5 vmax 0.1"], "servo area is -2, allowed: above 0"),
    ([WALL + "servo stress 1e6 area 1 gain 7 vmax 0.1"], "servo gain is 7, allowed: above 0 to 1"),
    ([WALL + "servo stress 1e6 area 1 gain 0.5 vmax 0"], "servo vmax is 0, allowed: above 0"),
    ([WALL + "servo stress 1e6 area 1 gain 0.5 vmax v_nothing"], "servo vmax is v_nothing, allowed: a number, or v_name of an equal-style variable"),
    ([WALL + "servo stress 1e6 area 1 gain 0.5"], "servo is missing, allowed: stress S area A gain C vmax V"),
    ([WALL + "servo stress v_nothing area 1 gain 0.5 vmax 0.1"], "servo stress is v_nothing, allowed: a number, or v_name of an equal-style variable"),
    ([WALL + "velocity 0", "fix_modify w servo stress 1"], "servo is missing, allowed: stress S area A gain C vmax V"),
    (["fix d all damping/local 1.5"], "alpha is 1.5, allowed: 0 to below 1"),
    (["fix d all damping/local"], "alpha is missing, allowed: 0 to below 1"),
    (["fix d all damping/local 0.5 0.5"], "an argument after alpha is 0.5, allowed: none"),
    (["fix p all poreforce pf"], "property is pf, allowed: the id of a fix property/atom with three values"),
    ([PROPERTY.replace("vector yes no no 0. 0. 0.", "scalar yes no no 0."), "fix p all poreforce pf"], "property is pf, allowed: the id of a fix property/atom"),
    (["fix t all poreforce/two_way pf"], "property is pf, allowed: the id of a fix property/atom with three values"),
    (["group some type 1", PROPERTY, "fix t some poreforce/two_way pf"], "group is some, allowed: all"),
    ([PROPERTY, "fix t all poreforce/two_way pf"], "poreforce/two_way: no fluid is coupled with it"),
]


def commands_scene(comm, commands: list[str]) -> None:
    scene = Scene(comm, [Grain((0.01, 0.01, 0.01)), Grain((0.03, 0.01, 0.01))])
    scene.commands("fix move all nve/sphere", *commands)
    scene.run(1)


def bad_commands_scene(comm) -> list[str]:
    """The messages of all of BAD, each from an engine of its own."""
    from coupling.errors import PoreslipError

    messages = []
    for commands, _ in BAD:
        try:
            commands_scene(comm, commands)
            messages.append("no error")
        except PoreslipError as error:
            messages.append(" ".join(str(error).split()))
    return messages


@pytest.fixture(scope="module")
def messages() -> list[str]:
    return run_scene(bad_commands_scene)[0]


@pytest.mark.parametrize("case", range(len(BAD)), ids=[message for _, message in BAD])
def test_bad_arguments_are_refused(case: int, messages: list[str]) -> None:
    assert re.search(BAD[case][1], messages[case]), messages[case]


@pytest.mark.parallel
def test_refused_on_two_ranks_without_a_hang() -> None:
    with pytest.raises(SceneError, match="alpha is 1.5, allowed: 0 to below 1"):
        run_scene(commands_scene, ranks=2, commands=["fix d all damping/local 1.5"])


def test_good_arguments_are_taken() -> None:
    run_scene(commands_scene, commands=[GOOD_BOND, WALL + "velocity 0", PROPERTY, "fix p all poreforce pf", "fix d all damping/local 0"])
