"""Solvers: find a plan or policy on a model. They never import physics or collision."""
