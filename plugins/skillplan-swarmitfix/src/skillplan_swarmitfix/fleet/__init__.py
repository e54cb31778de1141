"""Several walking bases on one bench; never a single base's task."""
