"""The command `poreflow`: a pack from a file, its pores and the flow in them, and a report."""
