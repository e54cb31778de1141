"""Conformance suites for plugin authors: inherit one, name your plugin, and run pytest.

::

    class TestMySolver(SolverSuite):
        solver = "my-solver"

Every built-in passes the same suites. The tasks they use are small and made here, so that
an installed skillplan is all they need; they go through the registry and the referee like any
other run. Nothing but tests imports this package.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
