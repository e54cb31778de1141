"""Execution of skills and plans in a simulated world."""
