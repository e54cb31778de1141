"""What every simulated arm shares: timed motions, how skills are executed, and what that proves.

It moves an arm in a world of which it knows no more than the interface in `simulator`: a plugin
with a physics engine brings that. No engine is imported here.
"""
