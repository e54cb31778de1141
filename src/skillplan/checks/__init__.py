"""Verdicts of back ends: asked for once, reused, kept on disk. It never knows about solvers."""
