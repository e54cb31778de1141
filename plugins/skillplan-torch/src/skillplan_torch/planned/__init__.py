"""Episodes planned with what a run has learned of its task, until nothing better is in sight.

It knows what was observed and nothing else: neither the task nor its back ends.
"""
