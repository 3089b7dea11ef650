"""The pore fluid of a run: prescribed, or solved one-way or two-way."""
