"""An arm in pybullet: skills executed, contacts logged, postconditions sensed.

It holds the engine, the detectors that read its contacts, and what they need; it never solves, and
never shows or stores anything.
"""

from skillplan_pybullet.body_shapes import quiet_output

# The simulator announces itself when it is imported, which is nobody's business.
with quiet_output():
    import pybullet as pybullet
