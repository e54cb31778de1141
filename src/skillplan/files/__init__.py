"""Reading and writing files safely: limits, regular files only, atomic replacement.

It never knows what a file means.
"""
