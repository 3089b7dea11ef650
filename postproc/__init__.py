"""Figures, tables and claims from the files of finished (or stopped) runs; it reads files only."""
