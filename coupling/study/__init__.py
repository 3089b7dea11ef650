"""Studies: one case or flow computed with several settings, the error of each against what it costs."""
