"""YADE's FlowEngine on the benchmark's pack: the peer's figures, from its own script. Run by run.py as

    yade -n -x yade_flow.py PACK.txt COUPLED_STEPS

PACK.txt: x y z r, its box in the first line (pack.py writes it). Prints one JSON line: CPU seconds of one update from positions to
forces with nothing reused (triangulation, conductances, assembly, CHOLMOD's factor, solve, forces), of a step with the factor at
hand, bytes a grain over the bare process, and grain-steps per CPU second of DEM and flow together, meshed anew every 200 steps.
"""

import json
import resource
import sys
import time

import numpy as np
from yade import *  # noqa: F403
from yade import utils

path, steps = sys.argv[-2], int(sys.argv[-1])
with open(path) as file:
    box = [float(word) for word in file.readline().split()[2:]]
spheres = np.loadtxt(path)

O.materials.append(FrictMat(young=1e6, poisson=0.5, frictionAngle=0.5, density=2600, label="spheres"))  # noqa: F405
O.materials.append(FrictMat(young=1e6, poisson=0.5, frictionAngle=0, density=0, label="walls"))  # noqa: F405
O.bodies.append(utils.aabbWalls([box[:3], box[3:]], thickness=0, material="walls"))
O.bodies.append([utils.sphere(s[:3], s[3], material="spheres") for s in spheres.tolist()])
flow = FlowEngine(  # noqa: F405
    dead=0, useSolver=3, permeabilityFactor=1, viscosity=10, clampKValues=False, defTolerance=-1, meshUpdateInterval=200,
    bndCondIsPressure=[0, 0, 1, 1, 0, 0], bndCondValue=[0, 0, 1, 0, 0, 0], boundaryUseMaxMin=[0, 0, 0, 0, 0, 0],
)
O.engines = [
    ForceResetter(),  # noqa: F405
    InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Box_Aabb()]),  # noqa: F405
    InteractionLoop([Ig2_Sphere_Sphere_ScGeom(), Ig2_Box_Sphere_ScGeom()], [Ip2_FrictMat_FrictMat_FrictPhys()], [Law2_ScGeom_FrictPhys_CundallStrack()]),  # noqa: F405
    flow,
    NewtonIntegrator(damping=0.2),  # noqa: F405
]
O.dt = 1e-9


def seconds(action):
    start = time.process_time()
    action()
    return time.process_time() - start


bare = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
fresh = seconds(flow.emulateAction)
memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - bare) * 1024 / len(spheres)
kept = min(seconds(flow.emulateAction) for _ in range(3))
flux = flow.getBoundaryFlux(flow.wallIds[3])
coupled = None
if steps > 0:
    O.run(1, True)
    coupled = steps * len(spheres) / seconds(lambda: O.run(steps, True))
print("RESULT " + json.dumps({"fresh": fresh, "kept": kept, "bytes_per_grain": memory, "outflow": abs(flux), "grain_steps_per_second": coupled}), flush=True)
