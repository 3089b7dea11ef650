"""The paper's claims on its Fig. 7, judged on each pair of runs that differ in the coupling alone."""

from __future__ import annotations

from collections.abc import Sequence

from .claims import Finding, verdict_of
from .coupling_pairs import Pair
from .run_sets import seed_of

LARGEST_SHARE = 0.05
"""Displacements agree when the root mean square of their difference is at most this share of theirs."""
LARGEST_CHANGE = 1e3
"""Pa; the paper's bound of the pressure change."""
FOUR_ORDERS = 10.0**-3.5
"""About four orders of magnitude: the largest share that rounds to 1e-4."""


def pair_findings(pairs: Sequence[Pair]) -> list[Finding]:
    """All findings, pair by pair."""
    found = []
    for pair in pairs:
        last, scope = pair.last, f"pack {seed_of(pair.one_way)}"
        share, change, stress = last.displacement_share, pair.largest_pressure, pair.horizontal_stress
        rows = (
            ("i, displacements", "One-way and two-way coupling give the same displacements",
             f"rms difference {100 * share:.3g} % of the rms displacement; largest {100 * last.worst_displacement_share:.3g} % of the largest",
             share, f"rms difference at most {100 * LARGEST_SHARE:g} % at the last snapshot", share <= LARGEST_SHARE),
            ("i, pressure", "The pressure changes by less than 1 kPa", f"largest change around a grain {change / 1e3:.3g} kPa; rms {pair.largest_rms_pressure / 1e3:.2g} kPa",
             change, f"below {LARGEST_CHANGE / 1e3:g} kPa in all snapshots", change < LARGEST_CHANGE),
            ("i, orders", "The pressure change is about four orders below the horizontal stress",
             f"{change / stress:.2g} of {stress / 1e6:.3g} MPa", change / stress, f"at most {FOUR_ORDERS:.2g}", change / stress <= FOUR_ORDERS),
        )  # fmt: skip
        found += [Finding(letter, pair.label, scope, statement, "Fig. 7", figure, value, criterion, verdict_of(holds))
                  for letter, statement, figure, value, criterion, holds in rows]
    return found
