"""Dynamic programming over feasible subsets (Held-Karp), from one end or both; it never solves a linear program."""
