"""Pore network and pore flow of grain packs: C++ on CGAL, MPI and PETSc, used through arrays."""

from __future__ import annotations

from flowsolver.network import ComputationError, InputError, PoreNetwork

__all__ = ["ComputationError", "InputError", "PoreNetwork"]
