"""Verdicts of back ends: the floor that queries them, once, reuses and keeps the answers.

It never knows about solvers.
"""
