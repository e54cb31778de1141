"""The sampler `optuna`: settings from Optuna, in a journal that processes share.

It runs no solver, and options have no meaning to it.
"""
