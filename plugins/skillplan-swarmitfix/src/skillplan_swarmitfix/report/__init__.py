"""The bench in a report: its pictures, its time line, and its bases in motion."""
