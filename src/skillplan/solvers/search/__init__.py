"""Search on the lazy model: exhaustive, exact, constraint satisfaction.

It never queries back ends.
"""
