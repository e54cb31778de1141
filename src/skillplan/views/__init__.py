"""How records are shown: tables, figures, videos.

It never computes a result, and only the CLI imports it.
"""
