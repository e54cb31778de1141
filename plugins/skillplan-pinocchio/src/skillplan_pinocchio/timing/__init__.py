"""How long the arm takes: paths in joint space timed within its limits, and bounds of their times.

It plans no motion and gives no verdicts.
"""
