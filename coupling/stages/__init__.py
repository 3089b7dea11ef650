"""What comes before loading: the pack, its initial stress, the bonds."""
