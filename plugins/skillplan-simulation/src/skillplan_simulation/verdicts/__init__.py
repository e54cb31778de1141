"""What a record shows: postconditions that were met or missed, contacts beyond a threshold.

It reads records; it never simulates anything.
"""
