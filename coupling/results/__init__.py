"""What a run leaves: history, snapshots, checkpoints, report."""
