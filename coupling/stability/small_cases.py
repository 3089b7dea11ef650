"""Small cases (TOML): scenes of the stability map, and those that the tests run. Packs of one text are kept for all of them."""

#: 138 grains in a box.
BOX = """\
scene = "sample"
pack.box_m = [0.01, 0.01, 0.01]
pack.porosity = 0.40
"""
#: The same, whose top is loaded by a tenth in 400 steps of the default length.
SAMPLE = BOX + """\
sample.walls = { z_top = "stress 1.1e7" }
sample.loading_time_s = 4e-5
flow.kind = "none"
output.history_interval_steps = 20
"""
#: The same over a drained bottom; 600 steps at a quarter of 0.63 sqrt(m_min / k_n).
WET = BOX + """\
material.local_damping = 0.2
loading.time_step_fraction = 0.25
sample.walls = { z_top = "stress 1.1e7" }
sample.loading_time_s = 3e-5
fluid.viscosity_Pa_s = 10.0
fluid.faces = { zmin = 0.0 }
flow.kind = "solve"
flow.interval_steps = 10
output.history_interval_steps = 40
"""
#: 467 grains around a gouge.
FAULT_BOX = """\
scene = "two_sides"
pack.box_m = [0.031, 0.007, 0.015]
fault.gouge_width_m = 0.005
material.local_damping = 0.2
output.history_interval_steps = 20
"""
FAULT_LOADING = """\

[loading]
horizontal_strain = 2e-4
strain_rate_per_s = 5.0
"""
#: Loaded in 396 steps of the default length, dry, with bonds that hold.
FAULT = FAULT_BOX + 'pressure.mode = "none"\n' + FAULT_LOADING
#: An upright fault of some hundred grains, periodic along it.
UPRIGHT_BOX = """\
scene = "supplement"
pack.box_m = [0.022, 0.007, 0.012]
fault.gouge_width_m = 0.005
fault.dip_degrees = 90.0
fault.end_band_m = 0.0
material.local_damping = 0.2
output.history_interval_steps = 20
"""
UPRIGHT = UPRIGHT_BOX + """\
pressure.mode = "none"
supplement.shear_stress_Pa = 1.2e7
supplement.ramp_time_s = 2e-5
supplement.hold_time_s = 4e-5
"""
