"""Processes that do jobs for this one.

The only floor that starts any, and it never knows what a job means.
"""
