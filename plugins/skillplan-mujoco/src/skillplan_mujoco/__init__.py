"""A second physics engine: skills executed by a simulated arm in MuJoCo.

What the arm does, and what that proves, is shared with every engine and lives in
`skillplan_simulation`; here is the world it does it in.
"""
