"""Verdicts of back ends: queried once, reused, kept on disk. It never knows about solvers."""
