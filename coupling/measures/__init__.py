"""What is measured of a run, and whether it is still sound."""
