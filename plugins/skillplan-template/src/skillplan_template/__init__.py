"""A solver plugin to copy: one solver, which uses nothing but the public names of skillplan."""
