"""The arm in a simulated world, and its control, with algebra in a fixed order.

It knows points, turns and forces; it never knows skills.
"""
