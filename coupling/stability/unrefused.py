"""`poreslip` that refuses no time step, interval or servo beforehand: what the limits are measured with. Only the stability map runs it."""

from __future__ import annotations

import sys

from coupling.case import staggered_limit
from coupling.command_line import main


def _without_refusals() -> None:
    from coupling.fluid.two_way_flow import TwoWayFlow

    staggered_limit.MARGIN = staggered_limit.LONGEST
    TwoWayFlow._refuse_unstable = lambda self, held: None


if __name__ == "__main__":
    _without_refusals()
    sys.exit(main())
