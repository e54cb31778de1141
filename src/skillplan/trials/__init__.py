"""Detectors and engines compared on executions known to be right or wrong.

Never a part of solving.
"""
