"""The inputs of ``skillplan report``: loaded, solved and performed, chapter by chapter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from skillplan.cli.interruption import Deadline, counting
from skillplan.cli.load import load_file, load_result, make_setup, verify_before_showing
from skillplan.cli.options.shared import BackEnds, ResultReading
from skillplan.cli.waiting import stoppable
from skillplan.cli.writing import tell
from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.files.json_file import parse_json, read_document
from skillplan.files.regular_file import read_bytes
from skillplan.physics.performance import MOST_PLAYED_S, PlannedMotion
from skillplan.pipeline.performing import (
    Performed,
    derive_geometric_chart,
    find_arm_meshes,
    perform_plan,
    plan_motion,
)
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import open_warm_cache, solve_problem
from skillplan.plugins.installed import list_distribution_versions
from skillplan.records import schemas
from skillplan.records.certificate import Certificate
from skillplan.records.execution.simulation import summarise_simulation
from skillplan.records.stored.result_folder import find_result_path, find_run_folder, is_result
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.views.figures.precedence_graph import PrecedenceGraph, build_precedence_graph
from skillplan.views.playback.arm_playback import PLANNED, build_arm_playback
from skillplan.views.playback.tracks import FRAMES_PER_S
from skillplan.views.report.chapters import (
    PlanInput,
    build_chain_chapter,
    build_plan_chapter,
    prepare_chain_input,
)
from skillplan.views.report.page import Chapter
from skillplan.views.report.solver_chapters import (
    build_advice_chapter,
    build_comparison_chapter,
    build_front_chapter,
)

_MOST_BYTES = 64 * 2**20
_REMEDY = "Give a result of search-optimal or compare, a task file, or a folder of train"
# Largest number of components in a picture of the precedence relation.
_MOST_COMPONENTS = 60
# Share of the remaining time for search or verification.
_SEARCH_SHARE = 0.6


# Documents that the page shows as they are, by schema.
_BUILD: Mapping[str, Callable[[Mapping[str, Any], str], Chapter]] = {
    schemas.ADVICE: build_advice_chapter,
    schemas.COMPARISON: build_comparison_chapter,
    schemas.FRONT: build_front_chapter,
}


@dataclass
class Reporter:
    """Makes the chapters of a page.

    Parameters
    ----------
    simulate
        True if plans are performed for the playback, false if they are played as planned.
    plays
        True if the page has a player.
    """

    reading: ResultReading
    back_ends: BackEnds
    deadline: Deadline
    simulate: bool
    plays: bool = True
    seed: int = 0
    playback: Mapping[str, Any] | None = None
    interrupted: bool = False

    def chapter(self, path: str, name: str, share: float = 1.0) -> Chapter:
        """Return the chapter on one input.

        Parameters
        ----------
        path, name
            Path of the input and name of the chapter.
        share
            Share of the remaining time for this chapter, from 0 to 1.

        Raises
        ------
        OptionError, TaskError
            If the input or an option is invalid.
        BackEndError
            If a back end fails.
        """
        folder = find_run_folder(path)
        if folder is not None:
            self.reading.refuse_task_file(path, "a folder of train")
            from skillplan.cli.training_runs.figures import make_training_chapter
            from skillplan.records.training.run_folder import RunFolder

            limit_s = self.deadline.share_s(_SEARCH_SHARE * share)
            return make_training_chapter(RunFolder(folder), name, limit_s)
        if not is_result(path):
            return self._of_task(path, name, self.deadline.share_s(_SEARCH_SHARE * share))
        stored, build = find_result_path(path), _BUILD.get(str(_schema(find_result_path(path))))
        if build is not None:
            self.reading.refuse_task_file(path, "no result of search-optimal")
            return build(read_document(stored, str(_schema(stored)), _REMEDY), name)
        return self._of_result(path, name)

    def _of_task(self, path: str, name: str, limit_s: float | None) -> Chapter:
        problem = load_file(path, self.reading, self.back_ends)
        part = self.reading.part
        setup = make_setup(self.back_ends, problem.tasks[-1], screening=True)
        with stoppable(limit_s, label=f"solving {problem.name}") as stop:
            result = solve_problem(
                problem, part, None, setup, seed=self.seed, stop=stop, cache=open_warm_cache()
            )
        self.interrupted = self.interrupted or result.interrupted
        result = replace(result, origin=setup.origin(path, part, self.reading.settings()))
        document = result.document()
        ways = tuple(step.get("way") for step in document["steps"])
        return self._chapter(problem, part, setup, document, ways, name)

    def _of_result(self, path: str, name: str) -> Chapter:
        loaded = load_result(path, self.reading, self.back_ends)
        certificate = verify_before_showing(
            path, self.reading.task_file, self.deadline.share_s(_SEARCH_SHARE)
        )
        document = read_document(find_result_path(path), schemas.RESULT, _REMEDY)
        ways: tuple[str | None, ...] = ()
        if not loaded.stored.is_chain:
            if loaded.stored.cost is not None:
                task, plan = loaded.planned()
                task.parse_sequence(",".join(plan))
                ways = loaded.taken_ways()
            fitting = [step.model_dump(exclude_none=True) for step in loaded.stored.steps]
            steps = zip(document["steps"], fitting, strict=True)
            document = {**document, "steps": [{**given, **own} for given, own in steps]}
        return self._chapter(
            loaded.problem, loaded.origin.part, loaded.setup, document, ways, name, certificate
        )

    def _chapter(
        self,
        problem: Problem,
        part: str | None,
        setup: Setup,
        document: Mapping[str, Any],
        ways: tuple[str | None, ...],
        name: str,
        certificate: Certificate | None = None,
    ) -> Chapter:
        description = str(getattr(problem.config, "description", "") or "")
        if problem.is_chain and part is None:
            document = {**document, "simulation": None}
            given = prepare_chain_input(problem, document, name, self.playback is None)
            self.playback = self.playback or given.playback
            given = replace(
                given,
                description=description,
                plugins=list_distribution_versions(),
                certificate=certificate,
            )
            return build_chain_chapter(given, name)
        task = problem.part(part)
        performed = self.deadline.attempt(lambda: self._perform(task, setup, document, ways))
        if performed is None:
            performed = f"it was left out, as --time-limit {self.deadline.time_limit_s:g} was over"
        playback = None
        missing = performed if isinstance(performed, str) else ""
        if isinstance(performed, Performed):
            if performed.samples and self.playback is None:
                looks = find_arm_meshes(task, performed.engine)
                done = performed.performance.skills
                played = build_arm_playback(task, done, performed.samples, looks)
                playback = self.playback = played.document()
            else:
                missing = _why_not_played(performed)
        elif isinstance(performed, PlannedMotion):
            looks = find_arm_meshes(task, None)
            played = build_arm_playback(task, performed.skills, performed.samples, looks, PLANNED)
            playback = self.playback = played.document()
        measured = performed if isinstance(performed, Performed) else None
        # A stored result can claim a simulation; the page shows only its own.
        document = {**document, "simulation": None}
        if measured is not None:
            skills = [task.skill(str(step["skill"])) for step in document["steps"]]
            outcome = summarise_simulation(task, skills, measured.engine, measured.performance)
            document["simulation"] = outcome.document()
        given_plan = PlanInput(
            document,
            task,
            description,
            list_distribution_versions(),
            self.deadline.attempt(lambda: self._graph(task, setup)) or self._late_graph(task),
            None if measured is None else measured.performance,
            "" if measured is None else measured.engine,
            playback,
            missing,
            performed.skills if isinstance(performed, PlannedMotion) else (),
            certificate=certificate,
        )
        return build_plan_chapter(given_plan, name)

    def _perform(
        self, task: Task, setup: Setup, document: Mapping[str, Any], ways: tuple[str | None, ...]
    ) -> Performed | PlannedMotion | str:
        """Return the performed plan, or else the planned motion, or else the reason in words."""
        plan = [str(step["skill"]) for step in document.get("steps") or ()]
        if not plan:
            return "there is no plan"
        if not task.scene.bodies or not task.scene.robots:
            return "the task has no bodies and arm to move"
        skills = [task.skill(name) for name in plan]
        if not self.simulate:
            return self._planned(task, setup, skills, ways)
        with counting("skills", len(skills)) as count:
            performed = perform_plan(
                task,
                setup,
                skills,
                ways,
                on_begin=lambda _: count.one_more(),
                stopped=lambda: count.interrupted,
            )
            self.interrupted = self.interrupted or count.interrupted
        if isinstance(performed, Performed):
            return performed
        planned = self._planned(task, setup, skills, ways)
        return f"{performed}; and {planned}" if isinstance(planned, str) else planned

    def _planned(
        self, task: Task, setup: Setup, skills: Sequence[Skill], ways: Sequence[str | None]
    ) -> PlannedMotion | str:
        """Return the planned motion, or the reason why it cannot be played."""
        if not self.plays:
            return "its player is not here"
        if self.playback is not None:
            return "the page plays another plan"
        planned = plan_motion(task, setup, skills, ways, frames_per_s=FRAMES_PER_S)
        if isinstance(planned, PlannedMotion) and not planned.samples:
            return "nothing has moved"
        return planned

    def _graph(self, task: Task, setup: Setup) -> PrecedenceGraph | None:
        """Return the precedence relation by geometry and by hand; None for neither."""
        if not task.operations or len(task.operations) > _MOST_COMPONENTS:
            return None
        try:
            chart, names = derive_geometric_chart(
                task, replace(setup, collision=(), physics=None), open_warm_cache()
            )
        except OptionError as error:
            tell(f"skillplan: note: the precedence relation is not derived: {error}")
            return build_precedence_graph(task, None) if task.chart else None
        return build_precedence_graph(task, chart, names)

    def _late_graph(self, task: Task) -> PrecedenceGraph | None:
        """Return the relation by hand, with a message if there was no time to derive one."""
        if not self.deadline.is_over() or not task.operations:
            return None
        tell("skillplan: note: the precedence relation is not derived: --time-limit was over")
        return build_precedence_graph(task, None) if task.chart else None


def _schema(path: Path) -> object:
    """Return the schema of a JSON file; None without a schema or for other files."""
    try:
        document = parse_json(read_bytes(path, _MOST_BYTES))
    except (OSError, ValueError):
        return None
    return document.get("schema") if isinstance(document, dict) else None


def _why_not_played(performed: Performed) -> str:
    if performed.performance.simulated_s > MOST_PLAYED_S:
        return f"the plan takes more than {MOST_PLAYED_S:,} s, and no more are played"
    return "the page plays another plan, or nothing has moved"
