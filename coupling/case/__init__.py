"""Case files: their schema, how they are read, and what is refused before a run begins."""
