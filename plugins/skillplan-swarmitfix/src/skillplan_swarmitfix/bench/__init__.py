"""The bench: pins, base positions, swings and their times; never a workpiece."""
