"""A task, or a plan of it, in formats that other tools read; and plans read back from them.

Writes no file itself, and decides nothing: what a format cannot say is refused in words.
"""
