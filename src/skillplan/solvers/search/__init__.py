"""Search on the lazy model: exhaustive, exact (A*), constraint satisfaction (CSP).

It never queries back ends.
"""
