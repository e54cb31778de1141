"""Kinds of task: a YAML schema and the grounding of its content to tasks, one folder a kind."""
