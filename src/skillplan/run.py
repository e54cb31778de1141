"""The straight line: load a task, choose back ends, solve, and have the referee judge."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from skillplan import registry
from skillplan.errors import BackEndError, Issue, OptionError, SearchStopped, SkillplanError
from skillplan.model.feasibility import Feasibility
from skillplan.model.skill_model import SkillModel
from skillplan.model.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.referee import cross_examine, judge
from skillplan.report.result import Result, Status
from skillplan.solvers.solution import Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.load import Problem, load_task
from skillplan.task.task import BackEndChoice, Task

DEFAULT_SOLVER = "exact"
DEFAULT_PHYSICS = "kinematic"


@dataclass(frozen=True)
class Setup:
    """Which back ends are asked, and the options given for plugins by name.

    Parameters
    ----------
    physics
        An engine's name; None for the task file's choice, or else ``kinematic``.
    collision
        Detectors' names; empty for the task file's choice, or else its chart, or else ``aabb``.
    options
        Plugin name to option values; they go before the task file's.
    """

    physics: str | None = None
    collision: tuple[str, ...] = ()
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def back_ends(self, task: Task) -> list[BackEnd]:
        """Return the back ends for a task, physics first.

        Raises
        ------
        OptionError
            If a back end refuses the task or an option is wrong.
        PluginError
            If a back end is unknown or broken.
        BackEndError
            If a back end fails to start.
        """
        made = [self._make("physics", self.physics_choice(task), task)]
        made += [self._make("collision", choice, task) for choice in self.collision_choices(task)]
        return made

    def physics_choice(self, task: Task) -> BackEndChoice:
        """Return the engine that will be asked."""
        named = self.physics or (task.physics.name if task.physics else DEFAULT_PHYSICS)
        declared = task.physics if task.physics and task.physics.name == named else None
        return declared or BackEndChoice(named)

    def collision_choices(self, task: Task) -> list[BackEndChoice]:
        """Return the detectors that will be asked."""
        declared = {choice.name: choice for choice in task.collision}
        named = self.collision or tuple(declared)
        if not named:
            named = ("precedence",) if task.chart else ("aabb",) if task.scene.bodies else ()
        return [declared.get(name, BackEndChoice(name)) for name in dict.fromkeys(named)]

    def _make(self, kind: str, choice: BackEndChoice, task: Task) -> BackEnd:
        values = {**choice.options, **self.options.get(choice.name, {})}
        back_end, refusal = _make_back_end(kind, choice.name, values, task)
        if refusal is not None:
            raise OptionError(f"{kind} {choice.name!r} cannot serve {task.name!r}: {refusal}")
        return back_end


def _make_back_end(
    kind: str, name: str, values: Mapping[str, Any], task: Task
) -> tuple[BackEnd, str | None]:
    """Return a back end for a task, and why it refuses the task, or None."""
    plugin = registry.load(kind, name)
    options = registry.make_options(kind, name, plugin, values)
    try:
        back_end: BackEnd = plugin(task, options)
        return back_end, back_end.refuses()
    except SkillplanError:
        raise
    except Exception as error:
        raise BackEndError(
            f"{kind} {name!r} failed on {task.name!r}: {type(error).__name__}: {error}"
        ) from error


def load_problem(path: str | os.PathLike[str], replaced: Collection[str] = ()) -> Problem:
    """Load a task file of any installed kind.

    Parameters
    ----------
    path
        The file.
    replaced
        ``physics``, ``collision`` or both, where the file's choice of back ends is not what
        will be asked: then it need not be installed.

    Raises
    ------
    TaskError
        With every fault of the file, also of the back ends that it chooses.
    """
    kinds = [kind for kind in ("physics", "collision") if kind not in replaced]

    def check_content(content: Mapping[str, Any]) -> Iterator[Issue]:
        for kind in kinds:
            section = content.get(kind)
            for name, options in section.items() if isinstance(section, dict) else ():
                if options is None or isinstance(options, dict):
                    for issue in registry.choice_issues(kind, name, options or {}):
                        yield issue.under(kind)

    def check_task(task: Task) -> Iterator[Issue]:
        chosen = {"physics": (task.physics,) if task.physics else (), "collision": task.collision}
        for kind in kinds:
            for choice in chosen[kind]:
                _, refusal = _make_back_end(kind, choice.name, choice.options, task)
                if refusal is not None:
                    message = f"cannot serve this task: {refusal}"
                    yield Issue(message, (kind, choice.name), at_key=True)

    return load_task(
        path,
        lambda kind: registry.load("domain", kind)(),
        registry.names("domain"),
        check_content,
        check_task,
    )


def make_feasibility(
    task: Task, setup: Setup = Setup(), cache: VerdictCache | None = None
) -> Feasibility:
    """Return the chain of checks for a task; a fresh cache in memory by default."""
    return Feasibility(task, setup.back_ends(task), cache)


def make_model(
    task: Task,
    setup: Setup = Setup(),
    cache: VerdictCache | None = None,
    overdue: Callable[[], bool] | None = None,
) -> SkillModel:
    """Return the lazy model of a task."""
    return SkillModel(make_feasibility(task, setup, cache), overdue)


def make_solver(name: str, options: Mapping[str, Any], stop: Stop | None = None) -> Solver:
    """Return a solver by name.

    Raises
    ------
    OptionError
        If an option is wrong.
    PluginError
        If the solver is unknown or broken.
    """
    plugin = registry.load("solver", name)
    solver: Solver = plugin(registry.make_options("solver", name, plugin, options), stop)
    return solver


def solve(
    task: Task,
    solver: str | Solver = DEFAULT_SOLVER,
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
) -> Result:
    """Solve a task and have the solution judged.

    Parameters
    ----------
    task
        What to solve.
    solver
        A solver's name, or a solver; the latter is given `stop`.
    setup
        Back ends and options.
    seed
        Governs all randomness.
    stop
        When to stop; by default never.
    cache
        Where verdicts are kept; a fresh one in memory by default.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong.
    BackEndError
        If a back end fails.
    """
    stop = Stop() if stop is None else stop
    if isinstance(solver, str):
        solver = make_solver(solver, setup.options.get(solver, {}), stop)
    else:
        solver.stop = stop
    cache = VerdictCache() if cache is None else cache
    model = make_model(task, setup, cache, stop.overdue)
    back_ends = model.feasibility.back_ends
    blank = Result(
        task=task.name,
        kind=task.kind,
        sha256=task.sha256,
        solver=solver.name,
        seed=seed,
        physics=setup.physics_choice(task).name,
        collision=",".join(choice.name for choice in setup.collision_choices(task)),
        status=Status.UNSOLVED,
        cost_unit=task.metric.unit,
    )
    refusal = _refusal(solver, model)
    if refusal is not None:
        return replace(blank, status=Status.REFUSED, reason=refusal)
    begin_s = time.perf_counter()
    solution = _search(solver, model, seed, stop)
    wall_s = time.perf_counter() - begin_s
    stats = model.stats
    expanded = solution.trace.get("expanded", solution.trace.get("visited"))
    blank = replace(
        blank,
        states=stats.states,
        expanded=expanded if isinstance(expanded, int) else stats.states,
        checks=stats.checks,
        cache_hits=stats.cache_hits,
        wall_s=wall_s,
        interrupted=stop.interrupted,
        trace=solution.trace,
    )
    dear = {back_end.name for back_end in back_ends if back_end.dear}
    # Verdicts of dear back ends were made by them, not by the solver, and are not asked twice.
    fresh = make_model(task, setup, cache.only(dear))
    result = judge(blank, solution, fresh, unknown_met=stats.unknown > 0, audit=not dear)
    if result.status in (Status.SOLVED, Status.UNSOLVED) and stop.reason:
        reason = f"{stop.reason}: {result.reason}" if result.reason else stop.reason
        result = replace(result, reason=reason)
    return result


def _refusal(solver: Solver, model: SkillModel) -> str | None:
    try:
        return solver.refuses(model)
    except SkillplanError:
        raise
    except Exception as error:
        raise SkillplanError(
            f"The solver {solver.name!r} failed: {type(error).__name__}: {error}"
        ) from error


def _search(solver: Solver, model: SkillModel, seed: int, stop: Stop) -> Solution:
    try:
        solution = solver.solve(model, seed=seed)
    except SearchStopped:
        return Solution(stop.best, stop.lower_bound)
    except SkillplanError:
        raise
    except Exception as error:
        raise SkillplanError(
            f"The solver {solver.name!r} failed: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(solution, Solution):
        raise SkillplanError(
            f"The solver {solver.name!r} returned {type(solution).__name__}, not a Solution."
        )
    return solution


def cache_folder() -> Path:
    """Return where verdicts are kept between runs: ``SKILLPLAN_CACHE_DIR``, or the user's cache."""
    chosen = os.environ.get("SKILLPLAN_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("skillplan")


def warm_cache() -> DiskVerdictCache:
    """Return the cache that is kept between runs."""
    return DiskVerdictCache(cache_folder() / "verdicts")


def solve_all(
    task: Task,
    solvers: Sequence[str],
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    make_stop: Callable[[str], Stop] = lambda name: Stop(),
    warm: bool = False,
) -> list[Result]:
    """Solve a task with several solvers, cold unless `warm`, and hold their claims together."""
    results = []
    for name in solvers:
        stop = make_stop(name)
        cache = warm_cache() if warm else VerdictCache()
        results.append(solve(task, name, setup, seed=seed, stop=stop, cache=cache))
        if stop.interrupted:
            break
    return cross_examine(results)
