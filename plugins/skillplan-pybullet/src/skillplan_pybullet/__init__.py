"""A Panda in pybullet: skills executed, contacts logged, postconditions sensed."""

from skillplan_pybullet.quiet_output import quiet_output

# The simulator announces itself when it is imported, which is nobody's business.
with quiet_output():
    import pybullet as pybullet
