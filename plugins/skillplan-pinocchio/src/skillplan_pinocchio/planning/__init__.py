"""Planned travels of the arm, and continuous collision checks."""
