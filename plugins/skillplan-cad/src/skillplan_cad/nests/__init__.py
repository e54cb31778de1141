"""Nests: blocks with a pocket for a part, to print, and their check."""
