"""Reinforcement learning: tabular control from episodes, and the interface of deep learners.

It never queries back ends.
"""
