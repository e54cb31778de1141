"""Fixtures are named situations."""

import pytest

from skillplan import testing


@pytest.fixture(scope="session")
def lid_task():
    """A box, a fuse that goes into it, and a lid that is screwed on."""
    return testing.lid_task()
