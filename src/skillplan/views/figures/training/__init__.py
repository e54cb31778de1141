"""Figures of training runs; never a run's computation."""
