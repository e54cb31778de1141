"""What is known of plugins before any is called: who installed them, and what they raise.

Imports no plugin; which are valid, `skillplan.pipeline.registry` says.
"""
