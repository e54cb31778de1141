"""Collision detectors: check a skill's motion. They know tasks, never physics or solvers."""
