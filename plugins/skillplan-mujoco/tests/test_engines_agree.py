"""How far MuJoCo and pybullet agree, and who reads contacts where only one of them is there."""

from __future__ import annotations

import sys
from contextlib import ExitStack, closing
from importlib.metadata import EntryPoints

import pytest

from board_situations import BOARD
from skillplan.chart import derive_chart
from skillplan.pipeline import Setup, load_problem, make_feasibility
from skillplan.plugins import installed
from skillplan.task import Task
from skillplan.testing import lid_task
from skillplan.trials import EngineAgreement, compare_engines
from skillplan_mujoco import MujocoEngine
from skillplan_simulation import ContactPairsDetector, contact_detectors

CONTACTS = ("contact-pairs",)


def compared(task: Task) -> EngineAgreement:
    """Return what both engines say of a task."""
    if sys.version_info >= (3, 12):
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")
    # Without a chart, so that feasibility comes from the engines alone.
    bare = task.replace(chart=(), collision=())
    with ExitStack() as opened:
        engines = {
            name: opened.enter_context(closing(make_feasibility(bare, Setup(name, CONTACTS))))
            for name in ("pybullet", "mujoco")
        }
        return compare_engines(bare, engines)


def test_contact_pairs_executes_in_mujoco_where_pybullet_is_not_installed(monkeypatch):
    """A detector without an engine beside it takes the one that there is."""
    left = EntryPoints(item for item in installed.registered("physics") if item.name != "pybullet")
    monkeypatch.setattr(contact_detectors, "registered", lambda kind: left)
    detector = ContactPairsDetector(lid_task())
    assert detector.refuses() is None
    assert isinstance(detector.engine, MujocoEngine)


def test_contact_pairs_without_any_engine_says_what_to_install(monkeypatch):
    """It refuses in words."""
    monkeypatch.setattr(contact_detectors, "registered", lambda kind: EntryPoints())
    refused = ContactPairsDetector(lid_task()).refuses()
    assert refused is not None
    assert "pip install skillplan-pybullet or skillplan-mujoco" in refused


@pytest.mark.slow(
    reason="some twenty executions by each engine; the comparison itself in every run"
)
def test_engines_agree_on_every_question_of_a_small_product():
    """All that is applicable in every state of the lid task."""
    result = compared(lid_task())
    assert result.complete
    assert result.contradictions == ()
    assert result.agree == result.questions > 40


@pytest.mark.release(reason="a minute of executions; a smaller product in the whole suite")
@pytest.mark.parametrize("product", ["inverter_board", "sensor_stack"])
def test_engines_agree_on_every_question_of_a_product(product):
    """In hundreds of states; and MuJoCo derives the hand-made chart."""
    task = load_problem(BOARD.parent / f"{product}.yaml").task
    result = compared(task)
    assert result.contradictions == ()
    assert result.agree == result.questions > 700
    with closing(make_feasibility(task, Setup("mujoco", CONTACTS))) as checks:
        chart = derive_chart(checks)
    assert (chart.missing, chart.extra) == ((), ())
