"""Checks in processes of their own: what runs at once, and what runs ahead.

It decides about no skill.
"""
