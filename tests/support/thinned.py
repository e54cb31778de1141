"""Parameters of which only some are in every run."""

import pytest


def slow_case(*values, reason, **options):
    """Return values of one case that is left to `make test-all`."""
    return pytest.param(*values, marks=pytest.mark.slow(reason=reason), **options)


def release_case(*values, reason, **options):
    """Return values of one case that is left to `make test-release`."""
    return pytest.param(*values, marks=pytest.mark.release(reason=reason), **options)


def thinned(values, *kept, why="two others in every run"):
    """Return parameters of which only those kept are in every run; a tuple is several values."""
    return [
        value
        if value in kept
        else slow_case(*(value if isinstance(value, tuple) else (value,)), reason=why)
        for value in values
    ]
