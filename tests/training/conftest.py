"""Situations of trainings: a learner on the path."""

import pytest

from tabular_learner import learner_installed


@pytest.fixture(scope="module")
def learner(tmp_path_factory):
    """The name of a learner that is quick and exact, here and in child processes."""
    with (
        pytest.MonkeyPatch.context() as patch,
        learner_installed(tmp_path_factory.mktemp("site") / "site", patch) as name,
    ):
        yield name
