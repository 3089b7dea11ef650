"""From a case's inputs to the `variable ... index` values of its decks."""

from __future__ import annotations

import math
from pathlib import Path

from coupling.case.run_case import RunCase
from coupling.case.schema import PACK
from coupling.scene.fault_geometry import LEFT, RIGHT, FaultGeometry
from coupling.stages.pack import exchange_step, packing_friction

#: Neighbour lists reach this far beyond contact, in mean diameters: about the cheapest in dense packs.
SKIN_DIAMETERS = 0.1
#: In the packing the drag stops a free grain in this many steps: in the closed box, and while its walls let go.
DRAG_STEPS, RELEASE_DRAG_STEPS = 100, 1500
#: Time step of the packing over the limit of a dense pack, whatever the loading takes.
PACK_TIME_STEP_FRACTION = 0.6
#: Local damping of the decks in.stress, with which the time step has to be stable too.
SETTLING_DAMPING = 0.7
#: Limits of the plates' speed while the initial stress settles and while it is loaded, m/s; and over the mean overlap in a step, which is
#: what counts where contacts are stiff: a plate that has lost its grains meets them again without a blow.
SETTLING_PLATE_SPEED, LOADING_PLATE_SPEED = 0.2, 2.0
SETTLING_PLATE_OVERLAPS, LOADING_PLATE_OVERLAPS = 0.06, 0.6
#: Overlapping grains move at most this part of a diameter in a step while they are pushed apart.
LARGEST_MOVE_DIAMETERS = 0.01
#: Bonds may stretch to the strength this many standard deviations above the mean before the neighbour list loses them.
STRETCH_DEVIATIONS = 6.0
PLATES = tuple(f"z_{end}_{side}" for end in ("bottom", "top") for side in ("left", "right"))
#: In the supplement's scene the grains this close to an x wall carry the shear stress, in mean diameters.
GRIP_DIAMETERS = 2.0
#: Servo of the walls of a sample: part of the gap in stress that a step closes, for the fluid behind the wall adds its stiffness to
#: that of the contacts; and the largest strain rate, 1/s.
SERVO_GAIN, SERVO_STRAIN_RATE = 0.3, 100.0
#: Gain of the servos of a fault's plates, or of the supplement's x walls, while it is loaded.
PLATE_GAIN = 0.8


def common_variables(case: RunCase) -> dict[str, object]:
    """Contacts and time step, the same in every stage."""
    tangential = "history"
    if case.bonded:
        tangential = f'"bond stretch_max {_stretch_limit(case):.6g}"'
    return {
        "inputs": Path(case.decks_directory),
        "scene": case.scene,
        "kn": case.normal_stiffness_N_per_m,
        "kt": case.shear_stiffness_N_per_m,
        "gamman": case.normal_damping_per_s,
        "friction": case.material.friction,
        "tangential": tangential,
        "bonded": int(case.bonded),
        "skin": SKIN_DIAMETERS * 2.0 * case.mean_radius_m,
        "time_step": case.time_step_s,
    }


def _stretch_limit(case: RunCase) -> float:
    """Longest stretch of a bond, over the distance of its grains in contact: its strength over k_n, and the gap it may start with."""
    bonds, radius = case.bonds, case.pack.diameter_m[1] / 2.0
    strongest = (bonds.strength_mean_Pa + STRETCH_DEVIATIONS * bonds.strength_sd_Pa) * math.pi * radius**2
    stretch = (strongest / case.normal_stiffness_N_per_m + bonds.gap_m) / case.pack.diameter_m[0]
    return min(max(1.1 * stretch, 0.005), 0.3)


def pack_variables(case: RunCase, grains: Path) -> dict[str, object]:
    """For in.pack."""
    mean_mass = case.pack.density_kg_m3 * math.pi / 6.0 * (2.0 * case.mean_radius_m) ** 3
    length, depth, height = case.pack.box_m
    loose = packing_friction(case.pack, case.periodic_z) > 0.0
    time_step = min(PACK_TIME_STEP_FRACTION * case.critical_time_step_s, case.stable_time_step_s(0.0, sheared=loose))
    values = common_variables(case) | {
        "time_step": time_step,
        "friction": 0.0,
        "grains": grains,
        "length": length,
        "depth": depth,
        "height": height,
        "periodic_z": int(case.periodic_z),
        "confining_stress": case.pack.confining_stress_Pa,
        "exchange_first": exchange_step(case.pack, case.periodic_z),
        "largest_move": LARGEST_MOVE_DIAMETERS * 2.0 * case.mean_radius_m,
        "drag": mean_mass / (DRAG_STEPS * time_step),
        "release_drag": mean_mass / (RELEASE_DRAG_STEPS * time_step),
    }
    return values | case.pack.deck_variables


def stress_variables(case: RunCase, before) -> dict[str, object]:
    """For in.stress: the parts of the fault in the box that the pack's walls make."""
    if not case.has_fault:
        return _settling_variables(case) | {"restart_in": before.restart, "initial_stress": case.initial_stress_Pa}
    fault = fault_geometry(case, before.manifest["walls"], case.pack.box_m[2])
    normal, half = fault.normal, 0.5 * fault.width
    left, right = fault.centre - half * normal, fault.centre + half * normal
    lower, upper = fault.lower, fault.upper
    values = _settling_variables(case) | {
        "restart_in": before.restart,
        "left": lower[0], "right": upper[0], "front": lower[1], "back": upper[1], "bottom": lower[2], "top": upper[2],
        "initial_stress": case.initial_stress_Pa,
        "pack_stress": case.pack.confining_stress_Pa,
        "wall_speed_limit": _plate_speed(case, SETTLING_PLATE_SPEED, SETTLING_PLATE_OVERLAPS),
        "normal_x": normal[0], "normal_z": normal[2],
        "interface_left_x": left[0], "interface_left_z": left[2],
        "interface_right_x": right[0], "interface_right_z": right[2],
        "end_band": case.fault.end_band_m,
        "area_x": fault.x_wall_area,
    }  # fmt: skip
    values |= _supplement_variables(case, fault)
    return values | {f"area_{plate[2:]}": area for plate, area in plate_areas(case, fault).items()}


def _settling_variables(case: RunCase) -> dict[str, object]:
    """Contacts, and a time step that is stable with the damping under which the initial stress settles."""
    return common_variables(case) | {"time_step": min(case.time_step_s, case.stable_time_step_s(SETTLING_DAMPING, case.material.friction > 0.0))}


def _plate_speed(case: RunCase, limit: float, overlaps: float) -> float:
    """Largest speed of a plate, m/s: `limit`, or `overlaps` times the mean overlap under the initial stress, sigma d^2 / k_n, in a step."""
    overlap = case.initial_overlap_m
    return min(limit, overlaps * overlap / case.time_step_s)


def _supplement_variables(case: RunCase, fault: FaultGeometry) -> dict[str, object]:
    """For held_supplement.include; empty in other scenes."""
    if case.scene != "supplement":
        return {}
    return {"shear_stress": case.supplement.shear_stress_Pa, "fault_area": fault.x_wall_area, "grip": GRIP_DIAMETERS * 2.0 * case.mean_radius_m}


def bond_variables(case: RunCase, before) -> dict[str, object]:
    """For in.bond: the strengths."""
    bonds = case.bonds
    fault = fault_geometry(case, before.manifest["geometry"], case.pack.box_m[2])
    return common_variables(case) | _supplement_variables(case, fault) | {
        "restart_in": before.restart,
        "bond_strength_mean": bonds.strength_mean_Pa,
        "bond_strength_sd": bonds.strength_sd_Pa,
        "bond_shear_ratio": bonds.shear_ratio,
        "bond_gap": bonds.gap_m,
        "bond_seed": bonds.seed,
    }


def servo_gains(case: RunCase) -> dict[str, float]:
    """Gain of each wall that holds a stress while the case is loaded, by fix id."""
    if case.scene == "sample":
        return {name: SERVO_GAIN for name in PACK if case.sample.motion(name)[0] == "stress"}
    names = ("x_left", "x_right") if case.scene == "supplement" else PLATES
    return dict.fromkeys(names, float(case.loading.deck_variables.get("servo_gain", PLATE_GAIN)))


def load_variables(case: RunCase, restart: Path, fault: FaultGeometry) -> dict[str, object]:
    """For in.load, in.load_supplement and in.load_sample."""
    values = common_variables(case) | {
        "restart_in": restart,
        "local_damping": case.material.local_damping,
        "pore_force": case.flow.pore_force if case.needs_mesh else "none",
    }
    if case.has_fault:
        values["servo_gain"] = PLATE_GAIN
    if case.scene == "supplement":
        values |= _supplement_variables(case, fault) | {"normal_stress": case.supplement.normal_stress_Pa, "area_x": fault.x_wall_area}
    elif case.scene == "sample":
        values |= {"initial_stress": case.initial_stress_Pa, "ramp_time": case.sample.ramp_time_s} | wall_motions(case)
    else:
        values |= {
            "wall_speed": 0.5 * case.loading.strain_rate_per_s * (fault.upper[0] - fault.lower[0]),
            "vertical_stress": case.loading.vertical_stress_Pa,
            "wall_speed_limit": _plate_speed(case, LOADING_PLATE_SPEED, LOADING_PLATE_OVERLAPS),
        }
        values |= {f"area_{plate[2:]}": area for plate, area in plate_areas(case, fault).items()}
    return values | case.loading.deck_variables


def fault_geometry(case: RunCase, walls: dict[str, float], periodic_height: float) -> FaultGeometry:
    """The fault in the box that the walls make; `periodic_height` where there are none at top and bottom."""
    bottom, top = walls.get("z_bottom", 0.0), walls.get("z_top", periodic_height)
    lower, upper = (walls["x_left"], walls["y_front"], bottom), (walls["x_right"], walls["y_back"], top)
    return FaultGeometry(lower, upper, case.fault.dip_degrees, case.fault.gouge_width_m)


def wall_motions(case: RunCase) -> dict[str, object]:
    """What each wall of the scene "sample" does, for in.load_sample: a velocity of its position, or a servo and the stress it ends at."""
    values: dict[str, object] = {}
    for name in PACK:
        kind, number = case.sample.motion(name)
        inwards = 1.0 if PACK.index(name) % 2 == 0 else -1.0
        values[f"stress_{name}"] = number if kind == "stress" else case.initial_stress_Pa
        values[f"motion_{name}"] = f'"velocity {inwards * number if kind == "speed" else 0.0:.17g}"'
        if kind == "stress":
            limit = SERVO_STRAIN_RATE * max(case.pack.box_m)
            values[f"motion_{name}"] = f'"servo stress v_wanted_{name} area v_area_{name[0]} gain {SERVO_GAIN:g} vmax {limit:.17g}"'
    return values


def loaded_areas(case: RunCase, fault: FaultGeometry) -> dict[str, float]:
    """Area of each wall that bears the initial stress, m^2, by fix id."""
    if not case.has_fault:
        size = [top - bottom for bottom, top in zip(fault.lower, fault.upper)]
        return {name: math.prod(size) / size["xyz".index(name[0])] for name in PACK}
    return plate_areas(case, fault) | {"x_left": fault.x_wall_area, "x_right": fault.x_wall_area}


def plate_areas(case: RunCase, fault: FaultGeometry) -> dict[str, float]:
    """Area of the block face that each plate bears on, m^2, by fix id; empty without plates."""
    if case.scene != "two_sides":
        return {}
    depth = fault.upper[1] - fault.lower[1]
    heights = {"bottom": fault.lower[2], "top": fault.upper[2]}
    return {
        f"z_{end}_{side}": depth * fault.block_face_length(block, height)
        for end, height in heights.items()
        for side, block in (("left", LEFT), ("right", RIGHT))
    }
