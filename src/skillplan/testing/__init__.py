"""Conformance suites for plugin authors: inherit one, name your plugin, and run pytest.

::

    class TestMySolver(SolverSuite):
        solver = "my-solver"

Every built-in plugin passes the same suites. Their tasks are small and need only an installed
skillplan. Like any run, they use the registry and the referee. Only tests import this package.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
