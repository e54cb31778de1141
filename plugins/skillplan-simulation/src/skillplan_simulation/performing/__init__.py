"""Whole plans executed without a break, and pictures of executions.

It shows what robots do in a simulated world; what is feasible is decided in `verdicts`.
"""
