"""Learning from episodes: tabular control, and the interface of deep learners.

It never queries back ends.
"""
