"""Loading task files, and constructing their back ends by name."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

from skillplan.checks.single_check import can_time
from skillplan.domains.domain import Domain
from skillplan.domains.load import FileChecks, Problem, load_task
from skillplan.errors import BackEndError, Issue, OptionError, SkillplanError
from skillplan.physics.engine import Engine
from skillplan.pipeline import registry
from skillplan.plugins.blame import blame
from skillplan.plugins.installed import AUTO, PREFERRED, find_simulator
from skillplan.records.result import Origin
from skillplan.task.back_end import BackEnd
from skillplan.task.task import BackEndChoice, Task
from skillplan.workers.executor import Executor, ExecutorChoice, MakeExecutor

DEFAULT_PHYSICS = "kinematic"
SCREEN = "swept"
"""The detector that rules out by geometry what an engine need not execute."""
BOXES = "aabb"
"""The geometric detector that is always installed."""
CHART = "precedence"
"""The detector that checks the hand-made chart of the task file, and no geometry."""
STABILITY = "stability"
"""The detector that checks that parts stand or are held; for files with workholders or holders."""
BACK_END_KINDS = ("physics", "collision")


@dataclass(frozen=True)
class Setup:
    """The back ends that are queried, and the options of plugins.

    Parameters
    ----------
    physics
        Name of an engine; None for the choice of the task file, or else ``kinematic``. ``auto`` is
        replaced by the installed engine that executes skills.
    collision
        Names of detectors; empty for the choice of the task file, or else ``swept``, or ``aabb``
        without ``swept`` or with several robots. A chart of the file is checked in addition.
        Names that include ``precedence`` are used as they are: alone it leaves geometry unchecked.
    options
        Plugin name to option values. They override the options in the task file.
    screening
        True if an installed geometric detector is queried before an engine that executes skills.
        The engine does not execute the skills that it refuses.
    executor
        Executor of the jobs. Results do not depend on it.
    with_chart
        True if a chart of the task file is checked although `collision` does not name it.
    """

    physics: str | None = None
    collision: tuple[str, ...] = ()
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    screening: bool = False
    executor: ExecutorChoice = field(default_factory=ExecutorChoice)
    with_chart: bool = True

    def __post_init__(self) -> None:
        if self.physics is not None:
            object.__setattr__(self, "physics", resolve_engine(self.physics))

    def back_ends(self, task: Task, spare: list[BackEnd] | None = None) -> list[BackEnd]:
        """Return the back ends for a task, physics first.

        Parameters
        ----------
        task
            The task whose skills are checked.
        spare
            Back ends constructed already. A fitting one is taken out of the list and used.

        Raises
        ------
        OptionError
            If a back end refuses the task or an option is wrong.
        PluginError
            If a back end is unknown or broken.
        BackEndError
            If a back end fails to start.
        """
        choices = [("physics", self.physics_choice(task))]
        choices += [("collision", choice) for choice in self.collision_choices(task)]
        spare = [] if spare is None else spare
        constructed = [self._make(kind, choice, task, spare) for kind, choice in choices]
        if self.screens(task):
            next(back_end for back_end in constructed if back_end.name == SCREEN).screens = True
        return constructed

    @property
    def in_worker(self) -> Setup:
        """The setup for a worker process, which starts no others."""
        return replace(self, executor=ExecutorChoice())

    @property
    def make_executor(self) -> MakeExecutor | None:
        """Returns an executor for a number of slots; None for processes of this machine."""
        return None if self.executor.is_default else self._executor

    def _executor(self, slots: int) -> Executor:
        return make_executor(self.executor, slots)

    def origin(self, file: str, part: str | None, changes: Mapping[str, str]) -> Origin:
        """Return the origin of a result: the task file and how it was read."""
        return Origin(
            file, part, changes, self.physics, self.collision, self.options, self.screening
        )

    def physics_choice(self, task: Task) -> BackEndChoice:
        """Return the engine that will be queried."""
        named = self.physics or (task.physics.name if task.physics else DEFAULT_PHYSICS)
        declared = task.physics if task.physics and task.physics.name == named else None
        return declared or BackEndChoice(named)

    def collision_choices(self, task: Task) -> list[BackEndChoice]:
        """Return the detectors that will be queried, the screen first."""
        named = self.named_collision_choices(task)
        screen = (
            [_map_choices(task).get(SCREEN, BackEndChoice(SCREEN))] if self.screens(task) else []
        )
        return [*screen, *named]

    def detector_names(self, task: Task) -> str:
        """Return the names of the detectors that will be queried, separated by commas."""
        return ",".join(choice.name for choice in self.collision_choices(task))

    def named_collision_choices(self, task: Task) -> list[BackEndChoice]:
        """Return the detectors that will be queried, except a screen."""
        declared = _map_choices(task)
        named = dict.fromkeys(self._detectors(task))
        return [declared.get(name, BackEndChoice(name)) for name in named]

    def screens(self, task: Task) -> bool:
        """Return whether a detector that no user named rules out skills before they are executed.

        Raises
        ------
        PluginError
            If the engine is unknown or broken.
        """
        if not self.screening or SCREEN in self._detectors(task):
            return False
        if not self.has_screen(task):
            return False
        return bool(registry.load("physics", self.physics_choice(task).name).expensive)

    def timed_by(self, task: Task) -> str:
        """Return the names of the back ends that plan times, separated by commas; may be empty.

        Raises
        ------
        PluginError
            If a back end is unknown or broken.
        """
        chosen = [("physics", self.physics_choice(task).name)]
        chosen += [("collision", choice.name) for choice in self.collision_choices(task)]
        screen = SCREEN if self.screens(task) else None
        tell = [n for kind, n in chosen if n != screen and can_time(registry.load(kind, n))]
        return ",".join(tell)

    def _detectors(self, task: Task) -> tuple[str, ...]:
        named = self.collision or tuple(choice.name for choice in task.collision)
        if not self.collision and not self.with_chart:
            named = tuple(name for name in named if name != CHART)
        if CHART in named:
            return named
        if not named and task.scene.bodies:
            named = (self.geometric_detector(task),)
        if task.scene.workholders or task.scene.holders:
            named = tuple(dict.fromkeys((*named, STABILITY)))
        return (*named, CHART) if task.chart and self.with_chart else named

    def geometric_detector(self, task: Task) -> str:
        """Return the name of the default geometric detector for a task."""
        return SCREEN if self.has_screen(task) else BOXES

    def warnings(self, task: Task, domain: Domain) -> Iterator[Issue]:
        """Yield warnings of the back ends about a task, with the paths of their keys.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        for back_end in self.back_ends(task):
            kind = "physics" if isinstance(back_end, Engine) else "collision"
            yield from _locate_issues(kind, back_end, back_end.warnings, domain)

    def has_screen(self, task: Task) -> bool:
        """Return whether the geometric detector is installed and serves the robots of a task."""
        return SCREEN in registry.names("collision") and len(task.scene.robots) == 1

    def _make(self, kind: str, choice: BackEndChoice, task: Task, spare: list[BackEnd]) -> BackEnd:
        values = {**choice.options, **self.options.get(choice.name, {})}
        back_end, refusal = _make_back_end(kind, choice.name, values, task, spare)
        if refusal is not None:
            raise OptionError(f"{kind} {choice.name!r} cannot serve {task.name!r}: {refusal}")
        return back_end


def resolve_engine(name: str) -> str:
    """Return the name of an engine; ``auto`` is pybullet if it is installed, or else mujoco.

    Raises
    ------
    OptionError
        If it is ``auto``, and no engine that executes skills is installed.
    """
    if name != AUTO:
        return name
    installed = find_simulator()
    if installed is None:
        known = " or ".join(f"skillplan-{engine}" for engine in PREFERRED)
        raise OptionError(f"physics 'auto' finds no engine that moves bodies: pip install {known}.")
    return installed


def make_executor(choice: ExecutorChoice, slots: int) -> Executor:
    """Return an executor with some slots, which has started no process yet.

    Raises
    ------
    OptionError
        If an option is wrong, or the executor takes no address.
    PluginError
        If the executor is unknown or broken.
    """
    plugin = registry.load("executor", choice.name)
    options = registry.make_options("executor", choice.name, plugin, choice.options)
    executor: Executor = plugin(slots, options, choice.address)
    return executor


def _map_choices(task: Task) -> dict[str, BackEndChoice]:
    return {choice.name: choice for choice in task.collision}


def _make_back_end(
    kind: str, name: str, values: Mapping[str, Any], task: Task, spare: list[BackEnd] | None = None
) -> tuple[BackEnd, str | None]:
    """Return a back end for a task, a `spare` one if it fits, and the reason why it refuses."""
    plugin = registry.load(kind, name)
    options = registry.make_options(kind, name, plugin, values)
    for candidate in spare or ():
        if type(candidate) is plugin and candidate.task is task and candidate.options == options:
            assert spare is not None
            spare.remove(candidate)
            return candidate, None
    try:
        back_end: BackEnd = plugin(task, options)
        return back_end, back_end.refuses()
    except BaseException as error:
        _blame(error, kind, plugin, task)


def _make_willing(kind: str, name: str, task: Task) -> BackEnd | None:
    """Return a back end that only the command line names, if it can find faults in a file.

    A back end that is unknown or broken, or refuses the task, is reported later, when it is
    constructed with the options of the command line.
    """
    try:
        plugin = registry.load(kind, name)
        if plugin.faults is BackEnd.faults:
            return None
        back_end, refusal = _make_back_end(kind, name, {}, task)
    except SkillplanError:
        return None
    return back_end if refusal is None else None


def _locate_issues(
    kind: str, back_end: BackEnd, ask: Callable[[], Mapping[str, str]], domain: Domain
) -> Iterator[Issue]:
    """Yield the faults or warnings of a back end with the paths of their keys."""
    try:
        messages = dict(ask())
    except BaseException as error:
        _blame(error, kind, type(back_end), back_end.task)
    for fact, message in messages.items():
        yield Issue(message, domain.locate(fact), at_key=True)


def _blame(error: BaseException, kind: str, plugin: type[BackEnd], task: Task) -> NoReturn:
    def say(words: str) -> str:
        return f"{kind} {plugin.name!r} failed on {task.name!r}: {words}"

    blame(error, plugin, say, BackEndError)


def load_problem(
    path: str | os.PathLike[str],
    queried: Mapping[str, Collection[str]] | None = None,
    changes: Mapping[str, str] | None = None,
    *,
    former: bool = False,
) -> Problem:
    """Load a task file of any installed kind.

    Parameters
    ----------
    path
        The file.
    queried
        Names of the back ends that will be queried by kind, ``physics`` or ``collision``; kinds
        left out are chosen by the file. Other back ends that the file names need not be installed.
        Their faults in the file are reported, too.
    changes
        Key path to YAML value, such as ``{"base.home": "C1"}``; they override the file.
    former
        True to accept and leave out options that were removed since, for stored results.

    Raises
    ------
    TaskError
        With all faults of the file, including faults that its back ends find.
    BackEndError
        If a back end fails to start.
    """
    checks = _BackEndChecks(queried or {}, former=former)
    problem = load_task(path, registry.InstalledDomains(), checks, changes)
    return replace(problem, spare_back_ends=checks.made)


class _BackEndChecks(FileChecks):
    """The checks of a file by the back ends that will be queried.

    Parameters
    ----------
    queried, former
        As in `load_problem`.

    Attributes
    ----------
    made
        The back ends that were constructed.
    """

    def __init__(self, queried: Mapping[str, Collection[str]], *, former: bool) -> None:
        self._queried, self._former = queried, former
        self.made: list[BackEnd] = []

    def content_issues(self, content: Mapping[str, Any]) -> Iterator[Issue]:
        """Yield unknown back ends and wrong options that the file chooses."""
        for kind in BACK_END_KINDS:
            section = content.get(kind)
            for name, options in section.items() if isinstance(section, dict) else ():
                if self._is_queried(kind, name) and (options is None or isinstance(options, dict)):
                    for issue in registry.choice_issues(
                        kind, name, self._keep_options(kind, name, options or {})
                    ):
                        yield issue.under(kind)

    def task_issues(self, task: Task, domain: Domain) -> Iterator[Issue]:
        """Yield reasons why back ends refuse a task, and faults that they find in its bodies."""
        chosen = {"physics": (task.physics,) if task.physics else (), "collision": task.collision}
        for kind in BACK_END_KINDS:
            for choice in (
                declared_choice
                for declared_choice in chosen[kind]
                if self._is_queried(kind, declared_choice.name)
            ):
                options = self._keep_options(kind, choice.name, choice.options)
                back_end, refusal = _make_back_end(kind, choice.name, options, task)
                if refusal is not None:
                    message = f"cannot serve this task: {refusal}"
                    yield Issue(message, (kind, choice.name), at_key=True)
                else:
                    self.made.append(back_end)
                    yield from _locate_issues(kind, back_end, back_end.faults, domain)
            declared = {declared_choice.name for declared_choice in chosen[kind]}
            for name in dict.fromkeys(self._queried.get(kind, ())):
                willing = None if name in declared else _make_willing(kind, name, task)
                if willing is not None:
                    self.made.append(willing)
                    yield from _locate_issues(kind, willing, willing.faults, domain)

    def _keep_options(self, kind: str, name: str, options: Mapping[str, Any]) -> Mapping[str, Any]:
        if not self._former or name not in registry.names(kind):
            return options
        removed = registry.load(kind, name).removed_options
        return {key: value for key, value in options.items() if key not in removed}

    def _is_queried(self, kind: str, name: str) -> bool:
        """Return whether a back end that the file chooses will be queried."""
        return kind not in self._queried or name in self._queried[kind]
