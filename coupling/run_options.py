"""What the command line asks of the driver beside the case itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RunOptions:
    """How runs are carried out; none of it changes what they compute."""

    # Results go to <output_root>/<stem of the case file>/<name of the run>/.
    output_root: Path = Path("out")
    # Print the plan and do nothing.
    dry_run: bool = False
    # Directory of the run to continue from its newest checkpoint; the case file then holds that one run.
    restart: Path | None = None
    # Refuse a two-way run beforehand whose time step or servos are known not to hold.
    refuse_unstable: bool = True
