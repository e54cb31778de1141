"""Fixtures are named situations."""

from pathlib import Path

import pytest

from skillplan import testing
from skillplan.pipeline import load_problem

CONFIGS = Path(__file__).parents[1] / "configs"


@pytest.fixture(scope="session", autouse=True)
def _no_columns():
    """No test depends on the width of the terminal that it is started from."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("COLUMNS", raising=False)
        yield


def pytest_addoption(parser):
    """Let the documentation be brought up to date by the tests that check it."""
    parser.addoption(
        "--update-transcripts",
        action="store_true",
        help="write what commands print into README and docs instead of comparing",
    )


@pytest.fixture(scope="session")
def lid_task():
    """A box, a fuse that goes into it, and a lid that is screwed on."""
    return testing.lid_task()


@pytest.fixture(scope="session")
def shut_box_task():
    """The lid task with a chart that leaves no plan."""
    return testing.shut_box_task()


@pytest.fixture(scope="session")
def board_task():
    """The inverter board of the paper."""
    return load_problem(CONFIGS / "inverter_board.yaml").task


@pytest.fixture(scope="session")
def motor_drive_task():
    """Twelve parts, five screws and three tools that are changed in actions of their own."""
    return load_problem(CONFIGS / "motor_drive.yaml").task
