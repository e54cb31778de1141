"""Situations of exporters."""

import pytest

from handovers import best


@pytest.fixture(scope="session")
def board():
    """The inverter board and its optimum of 1.86709 m."""
    return best("inverter_board")
