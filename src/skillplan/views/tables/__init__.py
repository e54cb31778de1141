"""Records as tables for terminal, CSV and Markdown; never a figure that a record does not hold."""
