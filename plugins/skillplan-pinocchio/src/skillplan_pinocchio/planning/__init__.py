"""Travels of the arm: straight in joint space, or planned round what stands in the way.

It looks at no task and gives no verdicts.
"""
