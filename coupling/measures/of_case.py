"""Which measures belong to a case."""

from __future__ import annotations

from coupling.case.run_case import RunCase
from coupling.measures.fault import Measures
from coupling.measures.sample import SampleMeasures


def measures_of(case: RunCase) -> type[Measures] | type[SampleMeasures]:
    """Those of a fault, or those of a box of grains."""
    return Measures if case.has_fault else SampleMeasures
