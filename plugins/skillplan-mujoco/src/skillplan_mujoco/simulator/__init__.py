"""The simulated world: one compiled model, of which every check has a part.

It is MuJoCo behind names and SI units; it never knows a skill or a task.
"""
