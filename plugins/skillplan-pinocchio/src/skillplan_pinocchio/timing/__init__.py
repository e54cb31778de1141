"""Trajectories along joint paths, and durations of skills."""
