"""What every sampler owes its users."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from skillplan.pipeline import registry
from skillplan.records.sweep.plan import Choice, Dimension, Span
from skillplan.sweep.parameter_study import make_sampler
from skillplan.sweep.sampler import Question, SharedTrials
from skillplan.testing.options import assert_options_described

SPACE: tuple[Dimension, ...] = (
    Span("rate", 1e-4, 1.0, logarithmic=True),
    Span("share", -1.0, 1.0),
    Span("count", 1, 9, whole=True),
    Choice("kind", ("plain", "bent")),
    Choice("size", (8, 16, 32), ordered=True),
    Choice("quick", (False, True)),
)


class SamplerSuite:
    """What every sampler owes its users.

    Attributes
    ----------
    sampler
        Its name.
    options
        Options to try it with.
    """

    sampler: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def join(self, folder: Path, first: dict[str, Any] | None = None) -> SharedTrials:
        """Return the trials of a folder, of a study that the suite is about."""
        question = Question(SPACE, {"study": "of the suite"}, first or {}, seed=7)
        return make_sampler(self.sampler, self.options).join(folder, question)

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry finds it under its name, with a summary and described options."""
        plugin = registry.load("sampler", self.sampler)
        assert plugin.name == self.sampler
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()
        assert Path(plugin.keeps).name == plugin.keeps

    def test_what_it_chooses_is_allowed(self, tmp_path: Path) -> None:
        """Values lie in their ranges, whole where they have to be, and of the type listed."""
        trials = self.join(tmp_path)
        for count in range(15):
            trial = trials.ask()
            assert set(trial.values) == {one.option for one in SPACE}
            for one in SPACE:
                assert one.holds(trial.values[one.option]), one
            trials.tell(trial, float(count % 4), [])

    def test_what_is_to_be_tried_first_is(self, tmp_path: Path) -> None:
        """Where it leaves options out, those are chosen."""
        first = {"rate": 0.25, "kind": "bent", "size": 16, "quick": True, "count": 3}
        trials = self.join(tmp_path, first)
        assert trials.ask().values.items() >= first.items()
        assert not trials.ask().values.items() >= first.items()

    def test_what_was_told_is_there_for_every_process(self, tmp_path: Path) -> None:
        """Values, figures and lines, by number; what was given up or is under way is not."""
        one = self.join(tmp_path)
        another = self.join(tmp_path)
        asked = [one.ask(), another.ask(), one.ask(), another.ask()]
        assert len({trial.number for trial in asked}) == 4
        another.tell(asked[1], 2.5, ["second", "line"])
        one.tell(asked[0], None, ["first"])
        another.give_up(asked[3])
        late = self.join(tmp_path)
        assert late.about == {"study": "of the suite"}
        for seen in (one, another, late):
            assert seen.done() == 2
            told = sorted(seen.finished(), key=lambda each: each.trial.number)
            assert [each.trial for each in told] == sorted(
                asked[:2], key=lambda trial: trial.number
            )
            by_number = {each.trial.number: each for each in told}
            assert by_number[asked[0].number].value is None
            assert by_number[asked[1].number].value == 2.5
            assert by_number[asked[1].number].lines == ("second", "line")

    def test_two_processes_do_not_begin_alike(self, tmp_path: Path) -> None:
        """What is drawn depends on the trial's number, not on the seed alone."""
        asked = [self.join(tmp_path).ask().values["share"] for _ in range(4)]
        assert len(set(asked)) == 4
