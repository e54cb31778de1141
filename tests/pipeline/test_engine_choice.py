"""Which engine `auto` stands for, and that it is said."""

from __future__ import annotations

from importlib.metadata import EntryPoint, EntryPoints

import pytest

from skillplan.errors import OptionError
from skillplan.pipeline import Setup, find_arm_meshes
from skillplan.plugins import installed
from skillplan.testing import lid_task


@pytest.fixture
def install(monkeypatch):
    """Have engines of these names installed, and no others."""

    def only(*names: str) -> None:
        entry_points = EntryPoints(
            EntryPoint(name, "nowhere:It", "skillplan.physics") for name in names
        )
        monkeypatch.setattr(installed, "registered", lambda kind: entry_points)

    return only


@pytest.mark.parametrize(
    ("installed", "expected"),
    [(("kinematic", "mujoco", "pybullet"), "pybullet"), (("kinematic", "mujoco"), "mujoco")],
)
def test_auto_is_pybullet_where_it_is_installed_else_mujoco(install, installed, expected):
    """A setup holds the name itself, so that results, tables and documents say it."""
    install(*installed)
    setup = Setup("auto")
    assert (setup.physics, setup.physics_choice(lid_task()).name) == (expected, expected)


def test_auto_without_an_engine_says_what_to_install(install):
    """In one line, naming both."""
    install("kinematic")
    with pytest.raises(OptionError, match="pip install skillplan-pybullet or skillplan-mujoco"):
        Setup("auto")


def test_an_arm_looks_the_same_whichever_engine_moved_it():
    """One engine brings meshes of the arm, and they are of the arm, not of the engine."""
    pytest.importorskip("pybullet_data")
    pytest.importorskip("skillplan_pybullet")
    looks = find_arm_meshes(lid_task(), "mujoco")
    assert any(looks)
    assert looks == find_arm_meshes(lid_task(), "pybullet") == find_arm_meshes(lid_task(), None)
