"""The detector `swept`: inverse kinematics, trajectory times and swept collisions of a Panda.

It computes geometry, without a simulator; it never executes a skill, solves or shows anything.
"""
