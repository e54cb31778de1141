"""Dynamic programming over feasible subsets (Held-Karp), from one end or both.

It never solves a linear program.
"""
