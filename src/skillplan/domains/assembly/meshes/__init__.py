"""Polyhedra that a task file names, read and checked; it never looks at a board."""
