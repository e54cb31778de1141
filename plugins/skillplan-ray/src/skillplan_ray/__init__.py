"""The executor `ray`: jobs are done by actors of a Ray cluster.

It knows jobs as bytes only, never tasks, back ends or what is learned.
"""

__version__ = "0.2.0"
