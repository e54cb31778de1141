"""A solver plugin to copy."""
