"""Collision detectors: rule on a skill's motion. They know tasks, never physics or solvers."""
