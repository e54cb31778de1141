"""Situations of exporters."""

from __future__ import annotations

import pytest

from handovers import best
from skillplan.exporters import Handover


@pytest.fixture(scope="session")
def board() -> Handover:
    """The inverter board and its optimum of 1.86709 m."""
    return best("inverter_board")
