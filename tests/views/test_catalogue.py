"""The catalogue of figures: every entry can be drawn, and listing them costs nothing."""

import importlib
import subprocess
import sys
from importlib.metadata import EntryPoint, EntryPoints

import pytest

from skillplan.errors import PluginError
from skillplan.pipeline import names
from skillplan.views import figures
from skillplan.views.figures import TASK_FIGURES

OF_SOP = figures.CatalogueEntry("the tour", "skillplan.views.figures.learning_figure", "sop")


@pytest.fixture
def register(monkeypatch):
    """Replace the figures of plugins by entry points that name objects of this module."""

    def replace(**entries):
        monkeypatch.setitem(sys.modules, "figures_under_test", sys.modules[__name__])
        points = EntryPoints(
            EntryPoint(name, f"figures_under_test:{value}", "skillplan.figure")
            for name, value in entries.items()
        )
        monkeypatch.setattr(figures.catalogue, "figures", lambda: points)

    return replace


@pytest.mark.parametrize("kind", names("domain"))
@pytest.mark.parametrize("name", figures.list_figure_names())
def test_a_figure_of_a_task_has_a_solver_its_runs_and_a_drawing(name, kind):
    """``plot`` calls these of a figure's module."""
    module = figures.load_figure_module(name, kind)
    assert isinstance(module.SOLVER, str)
    assert callable(module.runs)
    assert callable(module.draw)


@pytest.mark.parametrize("name", figures.RUN_FIGURES)
def test_a_figure_of_runs_has_its_module(name):
    """It holds a function named after the figure."""
    drawing = importlib.import_module(figures.RUN_FIGURES[name].module)
    assert callable(getattr(drawing, f"draw_{name}"))


def test_listing_the_figures_imports_nothing_heavy():
    """The help of ``plot`` names them all, and must come at once."""
    code = (
        "import sys, skillplan.views.figures.catalogue as catalogue;"
        "catalogue.describe_figures();"
        "print([m for m in ('numpy', 'matplotlib', 'pydantic', 'rich') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "[]" == done.stdout.strip()


def test_an_unknown_figure_is_a_key_error():
    with pytest.raises(KeyError, match="flowers"):
        figures.load_figure_module("flowers", "assembly")


def test_a_plugin_adds_a_figure(register):
    register(tour="OF_SOP")
    assert figures.list_figure_names() == [*TASK_FIGURES, "tour"]
    assert figures.describe_figures()["tour"] == "the tour"
    assert figures.load_figure_module("tour", "sop").__name__ == OF_SOP.module
    assert figures.load_figure_module("tour", "assembly").__name__ == OF_SOP.module, (
        "it refuses in its words"
    )


def test_a_figure_for_one_kind_replaces_the_figure_for_any_kind(register):
    register(gantt="OF_SOP")
    assert figures.list_figure_names() == list(TASK_FIGURES)
    assert figures.describe_figures()["gantt"] == f"{TASK_FIGURES['gantt'].line}; of sop: the tour"
    assert figures.load_figure_module("gantt", "sop").__name__ == OF_SOP.module
    assert figures.load_figure_module("gantt", "assembly").__name__ == TASK_FIGURES["gantt"].module


@pytest.mark.parametrize(
    ("value", "reason"),
    [("MISSING", "cannot be imported: AttributeError"), ("register", "is not a CatalogueEntry")],
)
def test_a_broken_figure_is_listed_with_the_reason(register, value, reason):
    """It breaks neither the help nor the other figures."""
    register(tour=value)
    assert reason in figures.describe_figures()["tour"]
    assert figures.load_figure_module("gantt", "assembly").SOLVER == "auto"
    with pytest.raises(PluginError, match=reason):
        figures.load_figure_module("tour", "sop")
