"""What every exporter owes its users."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from functools import cache
from pathlib import PurePath
from typing import Any, ClassVar

import pytest

from skillplan.errors import OptionError
from skillplan.exporters.exporter import Exporter, Handover
from skillplan.model.replay import replay
from skillplan.pipeline import registry
from skillplan.pipeline.exchange.export import exported, handed_over, make_exporter, notes_of
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_model, solve
from skillplan.task.task import Task
from skillplan.testing.options import assert_options_described
from skillplan.testing.tasks import chance_task, hostile_task, lid_task

_BY_CHART = Setup(collision=("precedence",))


class ExporterSuite:
    """What every exporter owes its users.

    Attributes
    ----------
    exporter
        Its name.
    options
        Options to try it with.
    """

    exporter: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def make(self) -> Exporter:
        """Return the exporter with the options of the suite."""
        return make_exporter(self.exporter, self.options)

    def handover(self, task: Task) -> Handover:
        """Return a task and its best plan, by its chart."""
        return solved_lid(task)

    def files(self, task: Task) -> Mapping[str, str | bytes]:
        """Return what the exporter makes of a task and its best plan."""
        return exported(self.make(), self.handover(task))

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry finds it under its name, with a summary and described options."""
        plugin = registry.load("exporter", self.exporter)
        assert plugin.name == self.exporter
        assert plugin.suffix == "" or plugin.suffix.startswith(".")
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()

    def test_it_makes_files_of_plain_names(self) -> None:
        """One where it has a suffix; none is empty, and texts can be written as UTF-8."""
        files = self.files(lid_task())
        assert files
        assert len(files) == 1 or not self.make().suffix
        for name, content in files.items():
            assert PurePath(name).name == name
            assert content.encode() if isinstance(content, str) else content

    def test_the_same_plan_makes_the_same_files(self) -> None:
        """To the byte, so that files can be compared."""
        assert self.files(lid_task()) == self.files(lid_task())

    def test_names_that_are_no_identifiers_do_no_harm(self) -> None:
        """Quotes, brackets, ends of comments, line breaks, names that differ by case alone."""
        assert self.files(hostile_task())

    def test_without_a_plan_it_hands_over_the_task_or_says_that_it_needs_one(self) -> None:
        """In words that say where plans are from."""
        model = make_model(lid_task(), _BY_CHART)
        with closing(model.feasibility):
            handover = handed_over(model, _BY_CHART, None)
            if not self.make().needs_plan:
                assert exported(self.make(), handover)
                return
            with pytest.raises(OptionError, match="hands over a plan: give a RESULT"):
                exported(self.make(), handover)

    def test_chance_is_handed_over_or_refused_in_words(self) -> None:
        """A grasp that may fail is not left out in silence."""
        handover = self.handover(chance_task())
        refusal = self.make().refuses(handover)
        if refusal is None:
            assert exported(self.make(), handover)
            return
        assert "chance" in refusal
        with pytest.raises(OptionError, match="cannot be exported"):
            exported(self.make(), handover)

    def test_its_notes_are_sentences(self) -> None:
        """If there are any."""
        assert all(note.strip() for note in notes_of(self.make(), self.handover(lid_task())))


def solved_lid(task: Task) -> Handover:
    """Return a task that is the lid task but for names and chance, with its best plan."""
    model = make_model(task, _BY_CHART)
    # The hostile task has other names in the same order.
    walked = replay(model, [task.skills[action] for action in _plan()])
    assert walked.complete, walked.violations
    model.feasibility.close()
    return handed_over(model, _BY_CHART, walked)


@cache
def _plan() -> tuple[int, ...]:
    """Return the best plan of the lid task, which all tasks of the suite have."""
    result = solve(lid_task(), "exact", _BY_CHART)
    return tuple(step.action for step in result.steps)
