"""The sampler `optuna`: settings chosen by Optuna, kept in a journal that processes share.

It holds nothing that runs a solver or knows what an option means.
"""
