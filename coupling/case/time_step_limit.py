"""The longest time step with which the contacts of a dense pack stay stable, known before it is made.

Velocity Verlet is stable while the largest eigenvalue of M^-1 (dt^2 K + 2 dt C) is below 4 (coupling/stability/contact_spectrum.py). For
grains of mass m with contacts of stiffness k_n, k_s = r k_n and damping gamma m / 2, and with t = dt / sqrt(m / k_n), that is
Lambda t^2 + Lambda' gamma sqrt(m / k_n) t < 4. In random packs one of three motions is the first to go: grains against their neighbours
(Lambda = 6 + 12 r), all grains turning in one sense, which shears every contact (26 r), or grains against their neighbours under strong
damping (6.5 + 0.7 r for both terms). The numbers bound the spectra of packs of porosity 0.36 to 0.46, 4.5 to 6.2 contacts a grain, sizes 1.2
to 10 apart, k_s / k_n from 0 to 1 and restitution from 0.01 to 1: they come 3 to 10 % below their limits where the sizes are nearly the same, and
further where they are not, for then the smallest grains touch few others: `poreslip stability --only 'grains/limit/*'` measures such packs.
"""

from __future__ import annotations

import math

#: Eigenvalues of the shapes above, over k_n / m: constant, and part that grows with k_s / k_n.
MOVING, TURNING, DAMPED = (6.0, 12.0), 26.0, (6.5, 0.7)
#: Part of the damping that acts on the motions that the springs drive.
DAMPING_SHARE = 2.0


def stable_time_step(mass_kg: float, normal_stiffness: float, shear_ratio: float, damping_per_s: float, local_damping: float = 0.0) -> float:
    """The longest stable time step, s, of a dense pack.

    mass_kg: of the lightest grains. normal_stiffness: k_n, N/m. shear_ratio: k_s / k_n. damping_per_s: gamma of F = -gamma m_eff v_n.
    local_damping: alpha of F -= alpha |F| sign(v), which makes the forces that drive a grain back larger by 1 + alpha.
    """
    period = math.sqrt(mass_kg / normal_stiffness)
    damping = damping_per_s * period
    driven = max(MOVING[0] + MOVING[1] * shear_ratio, TURNING * shear_ratio)
    damped = DAMPED[0] + DAMPED[1] * shear_ratio
    bound = 4.0 / (1.0 + local_damping)
    return period * min(_root(driven, DAMPING_SHARE * damping, bound), _root(damped, damped * damping, bound))


def _root(square: float, linear: float, bound: float) -> float:
    """Positive t with square t^2 + linear t = bound."""
    return 2.0 * bound / (linear + math.sqrt(linear**2 + 4.0 * square * bound))
