"""Constraint programming by OR-Tools: the order of skills as a circuit."""

__version__ = "0.2.0"
