"""What grades solvers: replays of plans, checks of claims, second proofs.

It never searches for a solver.
"""
