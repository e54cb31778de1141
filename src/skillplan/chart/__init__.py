"""Precedence derived from checks in hypothetical states; it never searches for a plan."""
