"""Arms: kinematics and control, hands and tools, and the arm in a simulated world.

It knows points and turns; it never knows skills, but for how a task's targets turn the hand.
"""
