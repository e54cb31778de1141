"""The simulated world: bodies with mass, contact and gravity, and the camera that looks at them.

It is the simulator behind names and SI units; it never knows a robot, a skill or a task.
"""
