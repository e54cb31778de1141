"""Detectors and engines compared on executions known to be right or wrong, and with each other.

Never a part of solving.
"""
