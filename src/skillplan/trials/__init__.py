"""Detectors and engines compared on executions known to be right or wrong; never a part of solving."""
