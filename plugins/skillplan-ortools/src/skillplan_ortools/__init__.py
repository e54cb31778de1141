"""Constraint programming by OR-Tools: the order of skills as a circuit."""

__version__ = "0.1.0"
