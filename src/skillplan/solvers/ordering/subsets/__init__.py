"""Dynamic programming over feasible subsets (Held and Karp), from one end or both."""
