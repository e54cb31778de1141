"""Skills executed in a simulated world, and the record of what happened.

It holds whatever the robot does there; it never decides what is feasible, which is for `verdicts`.
"""
