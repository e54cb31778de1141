"""PDDL 2.1: a task as typed domain and problem with action costs, and plans of its planners."""
