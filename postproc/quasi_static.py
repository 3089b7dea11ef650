"""How far a run is from quasi-static loading: left against right wall, vertical stress against the stress to be held."""

from __future__ import annotations

import numpy as np
import pandas as pd

from .run_files import Run
from .scene_geometry import is_upright


def wall_difference(history: pd.DataFrame) -> np.ndarray:
    """(n,): difference of the total stresses on the left and the right wall over their mean."""
    left, right = history["sigma_h_left_Pa"].to_numpy(float), history["sigma_h_right_Pa"].to_numpy(float)
    return 2.0 * np.abs(left - right) / np.maximum(np.abs(left + right), np.finfo(float).tiny)


def vertical_stress_error(run: Run) -> np.ndarray | None:
    """(n,): |sigma_v - sigma_v held| over the latter; None where no vertical stress is held."""
    held = run.case.get("loading", {}).get("vertical_stress_Pa")
    if is_upright(run) or not held:
        return None
    return np.abs(run.history["sigma_v_Pa"].to_numpy(float) - float(held)) / float(held)
