"""The catalogue of figures: every entry can be drawn, and listing them costs nothing."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from skillplan.views.figures.catalogue import RUN_FIGURES, TASK_FIGURES, figure_module


@pytest.mark.parametrize("name", TASK_FIGURES)
def test_a_figure_of_a_task_has_a_solver_its_runs_and_a_drawing(name: str) -> None:
    """What ``plot`` calls of a figure's module."""
    module = figure_module(name)
    assert isinstance(module.SOLVER, str)
    assert callable(module.runs)
    assert callable(module.draw)


@pytest.mark.parametrize("name", RUN_FIGURES)
def test_a_figure_of_runs_has_its_module(name: str) -> None:
    """It holds a function of the module's own name."""
    module = RUN_FIGURES[name].module
    drawing = importlib.import_module(f"skillplan.views.figures.{module}")
    assert callable(getattr(drawing, module.rpartition(".")[2]))


def test_listing_the_figures_imports_nothing_heavy() -> None:
    """The help of ``plot`` names them all, and must come at once."""
    code = (
        "import sys, skillplan.views.figures.catalogue;"
        "print([m for m in ('numpy', 'matplotlib', 'pydantic', 'rich') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "[]" == done.stdout.strip()


def test_an_unknown_figure_is_a_key_error() -> None:
    with pytest.raises(KeyError, match="flowers"):
        figure_module("flowers")
