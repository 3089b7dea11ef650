"""The driver of poreslip: case files, the DEM engine, the loop, the command line."""

from __future__ import annotations

__version__ = "0.1.0"
