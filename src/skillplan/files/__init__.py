"""Reading and writing files safely: limits, regular files only, atomic replacement.

It never knows what a file means; `schema_errors` only words what a schema finds wrong in one.
"""
