"""Figures of tasks and results: one file a figure, each returns a matplotlib Figure."""
