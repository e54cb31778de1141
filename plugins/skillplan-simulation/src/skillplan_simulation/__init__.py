"""Execution of skills by a simulated arm, and the verdicts on it, for any physics engine.

A plugin with an engine implements the interface in `simulator`. This package imports no engine.
"""
