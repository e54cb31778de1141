"""Training of one policy on random boards, and its test on other boards of the same family."""

from __future__ import annotations

import random
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from skillplan.domains.assembly.board_generator import MOST_PARTS, BoardGenerator
from skillplan.errors import OptionError
from skillplan.files.folder import HeldFolder
from skillplan.files.output_path import check_output_folder, report_write_errors
from skillplan.model.policy_value import roll_out
from skillplan.model.replay import Replay, replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.pipeline.solving import make_model, make_solver, solve
from skillplan.records.result import Status
from skillplan.records.training.relational_file import (
    FamilyTrial,
    RelationalContent,
    StoredRelational,
    read_relational,
    write_relational,
)
from skillplan.solvers.learning.family_learner import FamilyLearner, FamilyPolicy
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.task import Task

_FORM = re.compile(r"generated:(\d{1,3})(?:-(\d{1,3}))?")
# The range of random boards: number of tools, and fraction of all pairs that are ordered.
_TOOLS = (1, 4)
_DENSITIES = (0.1, 0.5)
TEST_BOARDS = 20
"""Number of unseen boards that a policy is tested on."""
# Time limit for proving the optimum of a test board [s].
_PROOF_S = 5.0
# Offset between the seeds of training and test boards, larger than any seed a user would give.
_TEST_SEED = 2**32


@dataclass(frozen=True)
class GeneratedFamily:
    """Random boards as `skillplan generate assembly` writes them.

    Every board has 1 to 4 tools and a density of 0.1 to 0.5, both drawn uniformly.

    Parameters
    ----------
    low, high
        Range of the number of parts, 1 <= low <= high.

    Raises
    ------
    OptionError
        If the range is empty, or exceeds the generator's limit.
    """

    low: int
    high: int

    def __post_init__(self) -> None:
        if not 1 <= self.low <= self.high <= MOST_PARTS:
            raise OptionError(
                f"--family {self}: parts must be LEAST-MOST with 1 <= LEAST <= MOST <= "
                f"{MOST_PARTS}."
            )

    def __str__(self) -> str:
        return f"generated:{self.low}-{self.high}"

    @classmethod
    def parse(cls, text: str) -> GeneratedFamily:
        """Read a family such as ``generated:6-12`` or ``generated:8``.

        Raises
        ------
        OptionError
            If the text has another form.
        """
        match = _FORM.fullmatch(text)
        if match is None:
            raise OptionError(
                f"--family {text}: is neither a number of layouts nor generated:LEAST-MOST, such "
                "as generated:6-12."
            )
        low = int(match[1])
        return cls(low, int(match[2] or low))

    def boards(self, count: int, seed: int) -> Iterator[BoardGenerator]:
        """Yield `count` boards.

        The same arguments yield the same boards; different seeds yield different boards.
        """
        draw = random.Random(f"{self} {seed}").random
        for number in range(count):
            parts = self.low + int((self.high - self.low + 1) * draw())
            tools = min(parts, _TOOLS[0] + int((_TOOLS[1] - _TOOLS[0] + 1) * draw()))
            density = round(_DENSITIES[0] + (_DENSITIES[1] - _DENSITIES[0]) * draw(), 2)
            yield BoardGenerator(parts, density, tools, seed * 1_000_000 + number)

    def tasks(self, count: int, seed: int) -> Iterator[Task]:
        """Yield the tasks of `boards`."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "board.yaml"
            for board in self.boards(count, seed):
                path.write_text(board.text(), encoding="utf-8")
                yield load_problem(str(path)).task


@dataclass(frozen=True)
class FamilyPlan:
    """A training on random boards.

    Parameters
    ----------
    solver, options
        The learner and its options.
    seed
        Seed of the boards and of the learner, >= 0.
    """

    family: GeneratedFamily
    solver: str
    options: dict[str, Any]
    seed: int

    def learner(self, stop: Stop) -> FamilyLearner:
        """Make the learner.

        Raises
        ------
        OptionError
            If an option is wrong, or the solver does not learn on families.
        PluginError
            If the solver is unknown, not installed or broken.
        """
        load_family_learner(self.solver)
        learner = make_solver(self.solver, self.options, stop)
        assert isinstance(learner, FamilyLearner)
        return learner


def load_family_learner(name: str) -> type[FamilyLearner]:
    """Return the class of a solver that learns on families of boards.

    Raises
    ------
    OptionError
        If the solver does not learn on families.
    PluginError
        If the solver is unknown, not installed or broken.
    """
    plugin = registry.load("solver", name)
    if not issubclass(plugin, FamilyLearner):
        raise OptionError(
            f"The solver {name!r} learns no policy that carries over from board to "
            "board; 'relational' of skillplan-torch does."
        )
    return plugin


class FamilyFolder(HeldFolder):
    """A new folder for a policy, as a context manager.

    Raises
    ------
    OptionError
        If the folder is not empty, or cannot be used.
    """

    def __init__(self, out: str) -> None:
        super().__init__(out)
        check_output_folder("--out", out)
        with self._opening("training"):
            pass


def train_family(
    plan: FamilyPlan, folder: FamilyFolder, stop: Stop, on_step: Callable[[], None]
) -> RelationalContent:
    """Train a policy, test it on unseen boards of the family, and store it.

    Parameters
    ----------
    stop
        Ends the training early; the policy is then stored without a test.
    on_step
        Called after every step of the learner.

    Raises
    ------
    OptionError
        If the learner refuses a board, or the policy cannot be written.
    """
    begin_s = time.perf_counter()
    learner = plan.learner(stop)
    count = learner.boards

    def models() -> Iterator[SkillModel]:
        for task in plan.family.tasks(count, plan.seed):
            yield make_model(task)

    lesson = learner.learn(models(), plan.seed, on_step)
    trial = None if stop() else _try_policy(lesson.policy, plan.family, plan.seed, stop)
    with report_write_errors("--out", folder.path):
        return write_relational(
            folder.path,
            lesson.policy,
            solver=plan.solver,
            options=learner.options.model_dump(mode="json"),
            family=str(plan.family),
            boards=count,
            seed=plan.seed,
            trace=lesson.trace,
            trial=trial,
            wall_s=time.perf_counter() - begin_s,
        )


def _try_policy(
    policy: FamilyPolicy, family: GeneratedFamily, seed: int, stop: Stop
) -> FamilyTrial:
    """Follow a policy greedily on boards that it was not trained on."""
    completed, deviations, boards = 0, [], 0
    for task in family.tasks(TEST_BOARDS, seed + _TEST_SEED):
        if stop():
            break
        boards += 1
        _, replayed = follow_policy(policy, task)
        if not replayed.complete:
            continue
        completed += 1
        best = solve(task, "auto", stop=Stop(time_limit_s=_PROOF_S))
        if best.status is Status.OPTIMAL and best.cost:
            deviations.append(max(0.0, replayed.cost / best.cost - 1))
    return FamilyTrial(
        boards=boards,
        completed=completed,
        proved=len(deviations),
        median_deviation=median(deviations) if deviations else None,
        greatest_deviation=max(deviations, default=None),
    )


def read_policy(folder: Path) -> StoredRelational:
    """Read the policy in a folder; raises the errors of `read_relational`."""
    return read_relational(folder, load_family_learner)


def follow_policy(
    policy: FamilyPolicy, task: Task, setup: Setup = Setup()
) -> tuple[Sequence[Skill], Replay]:
    """Follow a policy greedily on a task; return its skills and their replay.

    Under chance, every skill has its nominal outcome.

    Raises
    ------
    OptionError
        If the policy cannot act on the task.
    BackEndError
        If a back end fails.
    """
    model = make_model(task, setup)
    with closing(model.feasibility):
        skills = roll_out(model, policy.choice_on(model))
        return skills, replay(model, skills)
