"""The SwarmItFIX bench: tasks, a solver for several robots, figures and chapters of reports.

It imports nothing itself, because ``skillplan plot --help`` reads the lines of its figures.
"""
