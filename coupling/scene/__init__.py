"""Where the fault and the walls are."""
