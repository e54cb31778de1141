"""From CAD to a task: parts, contacts, screws, and which part blocks which in which direction.

Lengths are metres throughout; only `relation.json` and what is printed have millimetres.
"""

__version__ = "0.2.0"
