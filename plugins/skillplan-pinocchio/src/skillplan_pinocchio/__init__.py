"""Inverse kinematics, trajectory times and swept collision detection of a Panda."""
