"""Markov decision processes: dynamic programming on the arrays of a model; it never samples."""
