"""Descriptions of robots as data; it never moves one."""
