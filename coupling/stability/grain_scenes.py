"""Scenes of grains without a fluid: runs of the program at and beyond what its contacts bear."""

from __future__ import annotations

from pathlib import Path

from coupling.stability.program_run import Ran, judged, run
from coupling.stability.scene import REFUSED, STABLE, STOPPED, WARNED, Outcome, Scene
from coupling.stability.small_cases import FAULT, SAMPLE

#: Box, m, and diameters, m, by how far apart the sizes are.
SIZES = {"1.2": (0.01, (1.8e-3, 2.2e-3)), "3": (0.012, (1e-3, 3e-3)), "10": (0.02, (5e-4, 5e-3))}
FRACTIONS = (0.5, 0.7, 0.8, 0.9, 1.0, 1.2)
#: What is stable by coupling/case/time_step_limit.py with the default contacts, over 0.63 sqrt(m_min / k_n).
HOLDS = 0.81


def of_sizes(apart: str) -> tuple[str, str]:
    """`--set` values of a pack with these sizes."""
    box, diameters = SIZES[apart]
    return f"pack.box_m=[{box}, {box}, {box}]", f"pack.diameter_m=[{diameters[0]}, {diameters[1]}]"


def loaded(ran: Ran) -> tuple[bool, str]:
    """Whether the top bears what it was loaded with, with contacts that stay small."""
    stress, overlap = ran.history["sigma_z_Pa"][-1], ran.figures["overlap_max_over_d"]
    words = f"top bears {stress / 1.1e7:.4f} of its load, energy gain {ran.figures['energy_gain']:.1e}, overlap {overlap:.1e} d"
    return abs(stress / 1.1e7 - 1.0) < 0.05 and overlap < 0.02, words


def sheared(ran: Ran) -> tuple[bool, str]:
    """Of a fault: stresses on left and right walls agree."""
    left, right = ran.history["sigma_h_left_Pa"][-1], ran.history["sigma_h_right_Pa"][-1]
    intact = ran.history["bonds_intact"]
    words = f"sigma_h {left / 1e6:.1f} and {right / 1e6:.1f} MPa, bonds {intact[0]:.0f} to {intact[-1]:.0f}, energy gain {ran.figures['energy_gain']:.1e}"
    return abs(left - right) < 0.3 * abs(left + right), words


def sample(*settings: str, decks: dict[str, str] | None = None, figure=loaded):
    """Act of a scene on the box of grains."""
    return lambda directory: judged(run(directory, SAMPLE, *settings, decks=decks), figure)


def fault(*settings: str, decks: dict[str, str] | None = None):
    """Act of a scene on the fault."""
    return lambda directory: judged(run(directory, FAULT, *settings, decks=decks), sheared)


def _step_scenes() -> list[Scene]:
    scenes = []
    for apart in SIZES:
        for fraction in FRACTIONS:
            expected = STABLE if fraction <= HOLDS else REFUSED
            act = sample(*of_sizes(apart), f"loading.time_step_fraction={fraction}")
            scenes.append(Scene(f"grains/step/{apart}/{fraction}", f"DEM step at {fraction} of 0.63 sqrt(m_min/k_n), sizes {apart} apart", (expected,), act,
                                quick=apart == "1.2" and fraction in (0.8, 0.9)))
    # Behind the checks of the case: a deck's own step, 2.02e-7 s being 1.0.
    for fraction in (0.95, 1.2, 2.0):
        act = sample(decks={"in.load_sample": f"timestep {fraction * 2.02e-7:.4g}"})
        scenes.append(Scene(f"grains/step_of_deck/{fraction}", f"step of {fraction}, set in a deck, past the checks", (WARNED, STOPPED) if fraction == 0.95 else (STOPPED,), act, quick=fraction == 1.2))
    return scenes


def crossing(directory: Path) -> Outcome:
    """A grain thrown at a wall at 20 km/s: 2 mm a step."""
    return judged(run(directory, SAMPLE, decks={"in.load_sample": "group thrown id 5\nvelocity thrown set 2e4 0. 0. units box"}), loaded)


def scenes() -> list[Scene]:
    """All of them, in the order of the table."""
    # Packed at the overlap that the stress makes in the default contacts, and unloaded, as in cases/two_sides/literal_stiffness.toml.
    literal = sample('material.stiffness_reading="literal"', "sample.ramp_time_s=2e-6", "sample.loading_time_s=4e-6", "pack.confining_stress_Pa=6.4e9",
                     "sample.initial_stress_Pa=6.4e9", 'sample.walls={ z_top = "stress 6.5e9" }', figure=at_least_sound)  # fmt: skip
    found = _step_scenes()
    found += [
        Scene("grains/literal_stiffness", "k_n = 5e10 N/m", (STABLE,), literal),
        Scene("grains/soft", "k_n 1e4 times smaller: grains overlap by half a diameter under the stress", (REFUSED, STOPPED), sample("material.modulus_Pa=5e6", "sample.loading_time_s=4e-3")),
        Scene("grains/friction/0", "contact friction 0", (STABLE,), sample("material.friction=0.0")),
        Scene("grains/friction/10", "contact friction 10", (STABLE,), sample("material.friction=10.0")),
        Scene("grains/shear_stiffness/1", "k_s = k_n at the default step", (STABLE,), sample("material.shear_stiffness_ratio=1.0")),
        Scene("grains/restitution/0.001", "restitution 0.001 at the default step", (REFUSED,), sample("material.restitution=0.001"), quick=True),
        Scene("grains/local_damping/0.99", "local damping 0.99 at the default step", (STABLE,), sample("material.local_damping=0.99", figure=at_least_sound)),
        Scene("grains/density/1e-6", "density 1e-6 times that of quartz: walls need 1000 times as many steps", (STOPPED,),
              sample("pack.density_kg_m3=2.65e-3", "sample.ramp_time_s=2e-8", "sample.loading_time_s=4e-8")),
        Scene("grains/density/4e5", "density 4e5 times that of quartz, with the box loaded as much slower", (STABLE,),
              sample("pack.density_kg_m3=1e9", "sample.ramp_time_s=1.2e-2", "sample.loading_time_s=2.4e-2")),
        Scene("grains/density_ratio/heavy", "every other grain 1e6 times as heavy", (STABLE,),
              sample(decks={"in.load_sample": EVERY_OTHER.format(density=2.65e9)}, figure=at_least_sound)),
        Scene("grains/density_ratio/light", "every other grain 1e6 times as light, set in a deck: the step is 1000 times its limit", (STOPPED,),
              sample(decks={"in.load_sample": EVERY_OTHER.format(density=2.65e-3)}, figure=at_least_sound)),
        Scene("grains/graded", "sizes 10 apart, loaded", (STABLE,), sample(*of_sizes("10"))),
        Scene("grains/fluidised", "porosity 0.9 asked for: no pack bears a stress there", (REFUSED, STOPPED), sample("pack.porosity=0.9"), quick=True),
        Scene("grains/thrown", "a grain thrown through a wall at 20 km/s", (STOPPED,), crossing, quick=True),
        Scene("grains/one", "all grains but one deleted in a deck", (STOPPED,), sample(decks={"in.load_sample": DELETED.format(kept=2)})),
        Scene("grains/none", "all grains deleted in a deck", (STOPPED,), sample(decks={"in.load_sample": DELETED.format(kept=1)})),
        Scene("grains/small_box", "a box for no grain", (REFUSED,), sample("pack.box_m=[0.001, 0.001, 0.001]")),
        *(Scene(f"grains/overlap/{share:g}", f"sizes changed in a deck so that grains overlap by {share:g} of d, let go between walls", (STABLE,),
                sample("material.local_damping=0.2", decks={"in.load_sample": f"set group all diameter {diameter:g}"}, figure=let_go))
          for share, diameter in ((0.05, 1.89e-3), (0.17, 2.15e-3))),
        Scene("grains/bonds/0", "bond strength 0", (REFUSED,), fault("bonds.strength_mean_Pa=0.0"), quick=True),
        Scene("grains/bonds/small", "bond strength 1 Pa: every bond breaks at once", (STABLE,), fault("bonds.strength_mean_Pa=1.0", "bonds.strength_sd_Pa=0.0")),
        Scene("grains/bonds/1e15", "bond strength 1e15 Pa: none breaks", (STABLE,), fault("bonds.strength_mean_Pa=1e15")),
        Scene("grains/bonds/inf", "bond strength infinite", (REFUSED,), fault("bonds.strength_mean_Pa=inf"), quick=True),
    ]  # fmt: skip
    return found


#: Densities of every other grain, kg/m^3, once the grains are there.
EVERY_OTHER = """\
variable odd atom id%2
group odd variable odd
set group odd density {density:g}
"""


#: All grains from this id on, deleted.
DELETED = """\
run 0
variable gone atom id>={kept}
group gone variable gone
delete_atoms group gone compress no
"""


def let_go(ran: Ran) -> tuple[bool, str]:
    """Overlaps fall, and grains and walls gain nothing from them but what they held."""
    overlap = ran.history["overlap_max_over_d"]
    return overlap[-1] < overlap[0], f"overlap {overlap[0]:.3g} to {overlap[-1]:.3g} d, energy gain {ran.figures['energy_gain']:.1e}"


def at_least_sound(ran: Ran) -> tuple[bool, str]:
    """For runs too slow to bear their load."""
    return ran.figures["overlap_max_over_d"] < 0.02, f"energy gain {ran.figures['energy_gain']:.1e}, overlap {ran.figures['overlap_max_over_d']:.1e} d"

