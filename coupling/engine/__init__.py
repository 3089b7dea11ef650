"""The DEM engines, behind one interface."""
