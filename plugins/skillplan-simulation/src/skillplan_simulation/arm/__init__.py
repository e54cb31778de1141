"""An arm that is to be moved: its kinematics, its motions over time, and what is at its end.

It knows points and turns; it never knows skills, but for how a task's targets turn the hand.
"""
