"""Solvers of tasks with chance and too many states for tables; they never list all states."""
