"""The solver `cp-sat`, by OR-Tools: the order of jobs as a circuit of a constraint model.

It knows sequencing problems only, never tasks or back ends.
"""

__version__ = "0.2.0"
