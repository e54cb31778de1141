"""Plans performed by an engine or by a planner of paths, and the relation that geometry gives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import introduce
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import BackEndError, OptionError, PluginError, name_hint
from skillplan.physics.performance import (
    MOST_PLAYED_S,
    MotionPlans,
    Performance,
    Performer,
    PlannedMotion,
    Sample,
)
from skillplan.pipeline import registry
from skillplan.pipeline.setup import BOXES, DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.pipeline.solving import make_feasibility, make_model
from skillplan.plugins.blame import blame
from skillplan.plugins.installed import PREFERRED
from skillplan.records.execution.simulation import PlannedTimes
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def by_ways(
    task: Task,
    skills: Sequence[Skill],
    back_ends: Sequence[BackEnd],
    named: Sequence[str | None] = (),
    stopped: Callable[[], bool] = lambda: False,
) -> list[Skill]:
    """Return the skills of a plan, those with several ways by the one that is taken.

    Parameters
    ----------
    task
        Whose skills.
    skills
        The plan, each applicable when its turn comes.
    back_ends
        Asked for the way of each skill that has several and for which none is named.
    named
        The ways in words, as far as they are known, by step; None where a skill has but one.
    stopped
        Whether to stop asking; then first ways are taken.

    Raises
    ------
    OptionError
        If a way is named that a skill does not have.
    BackEndError
        If a back end fails.
    """
    if not any(skill.ways for skill in skills):
        return list(skills)
    feasibility = Feasibility(task, back_ends)
    state, found = task.initial, []
    for index, skill in enumerate(skills):
        label = named[index] if index < len(named) else None
        if not skill.ways:
            found.append(skill)
        elif label is not None:
            labels = [way.label for way in skill.ways]
            if label not in labels:
                hint = name_hint(label, labels)
                raise OptionError(f"Step {index + 1}: {skill.name} has no way {label!r}. {hint}")
            found.append(feasibility.variants.by_label(skill, label))
        elif stopped():
            found.append(skill.by(skill.ways[0]))
        else:
            found.append(feasibility.taken(skill, state))
        state = skill.prediction_in(state).apply(state)
    return found


ANY_DETECTOR = "aabb"
"""A detector that always serves, and that is not queried."""


def performing_engine() -> str | None:
    """Return the installed engine that performs plans where none is chosen; None without one."""
    known = registry.names("physics")
    able = (name for name in PREFERRED if name in known)
    return next(
        (name for name in able if issubclass(registry.load("physics", name), Performer)), None
    )


def looks_of_arm(task: Task, performed_by: str | None) -> Sequence[Path | None]:
    """Return what base and links of an arm look like, as far as an installed engine has meshes.

    Parameters
    ----------
    task
        The arm is that of its robot.
    performed_by
        The engine that moved it, which is asked first; None for none.
    """
    arm, known = task.scene.robots[0].model, registry.names("physics")
    for name in sorted(set(PREFERRED) & set(known), key=lambda name: name != performed_by):
        try:
            engine = registry.load("physics", name)
        except PluginError:
            # Another engine that is broken takes no page down: links look like what they hit with.
            continue
        found = engine.looks(arm) if issubclass(engine, Performer) else ()
        if any(found):
            return found
    return ()


def contact_detectors(engine: str, chosen: Collection[str]) -> list[str]:
    """Return the detectors that rule on contacts: of those chosen, or else the engine's first."""
    known = getattr(registry.load("physics", engine), "contact_detectors", ())
    able = [name for name in known if name in registry.names("collision")]
    return [name for name in able if name in chosen] or able[:1]


@dataclass(frozen=True, slots=True)
class Performed:
    """A plan that was performed.

    Parameters
    ----------
    engine
        The engine's name.
    performance
        What was measured.
    samples
        The rows of the trace; none of a plan that is too long to be played.
    back_end
        The engine.
    """

    engine: str
    performance: Performance
    samples: Sequence[Sample]
    back_end: Performer


def perform_plan(
    task: Task,
    setup: Setup,
    skills: Sequence[Skill],
    ways: Sequence[str | None] = (),
    *,
    begun: Callable[[str], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Performed | str:
    """Perform a plan and return what was measured, or say in words why it is not.

    Parameters
    ----------
    task
        Whose plan it is.
    setup
        Its engine is taken if it moves bodies; else that of `performing_engine`.
    skills
        The plan, each applicable when its turn comes.
    ways
        As in `by_ways`.
    begun
        Called with the name of each skill that begins.
    stopped
        Called often; once true, the plan ends after the current skill.

    Raises
    ------
    BackEndError
        If the engine fails.
    """
    named = setup.physics_choice(task).name
    performs = issubclass(registry.load("physics", named), Performer)
    engine = named if performs else performing_engine()
    if engine is None:
        known = " or ".join(f"skillplan-{name}" for name in PREFERRED)
        return f"no engine that moves bodies is installed: pip install {known}"
    chosen = [choice.name for choice in setup.named_collision_choices(task)]
    detectors = tuple(contact_detectors(engine, chosen)) or (ANY_DETECTOR,)
    taking = replace(setup, physics=engine, collision=detectors, screening=False, with_chart=False)
    try:
        made = introduce(taking.back_ends(task))
    except OptionError as error:
        return str(error)
    performer = _performer(made)
    samples: list[Sample] = []
    under_way = [""]

    def note(sample: Sample) -> None:
        if sample.time_s <= MOST_PLAYED_S:
            samples.append(sample)
        if sample.skill and sample.skill != under_way[0]:
            under_way[0] = sample.skill
            begun(sample.skill)

    taken = by_ways(task, skills, made, ways, stopped)
    try:
        performance = performer.perform(taken, note=note, stopped=stopped)
    except BaseException as error:
        blame(
            error,
            type(performer),
            lambda words: f"Back end {engine!r} failed: {words}",
            BackEndError,
        )
    kept = samples if performance.simulated_s <= MOST_PLAYED_S else []
    return Performed(engine, performance, kept, performer)


def _performer(made: Sequence[BackEnd]) -> Performer:
    return next(one for one in made if isinstance(one, Performer))


def plan_motion(
    task: Task,
    setup: Setup,
    skills: Sequence[Skill],
    ways: Sequence[str | None] = (),
    *,
    frames_per_s: int,
) -> PlannedMotion | str:
    """Return where arm and parts are in a plan, or say in words why nobody knows.

    Parameters
    ----------
    task
        Whose plan it is.
    setup
        Has the options of what plans paths.
    skills
        The plan, each applicable when its turn comes.
    ways
        As in `by_ways`.
    frames_per_s
        How many samples there are to a second, >= 1.

    Raises
    ------
    BackEndError
        If what plans paths fails.
    """
    if SCREEN not in registry.names("collision"):
        return "nothing that plans paths is installed: pip install skillplan-pinocchio"
    asked = replace(
        setup, physics=DEFAULT_PHYSICS, collision=(SCREEN,), screening=False, with_chart=False
    )
    try:
        made = introduce(asked.back_ends(task))
    except OptionError as error:
        return str(error)
    plans = next((one for one in made if isinstance(one, MotionPlans)), None)
    if plans is None:
        return f"{SCREEN} tells no paths of whole plans"
    taken = by_ways(task, skills, made, ways)
    try:
        return plans.planned_motion(taken, frames_per_s)
    except ValueError as error:
        return str(error)
    except BaseException as error:
        blame(
            error,
            type(plans),
            lambda words: f"Back end {SCREEN!r} failed: {words}",
            BackEndError,
        )


def planned_times(
    task: Task,
    skills: Sequence[Skill],
    timed_by: str,
    options: Mapping[str, Mapping[str, Any]],
) -> PlannedTimes | None:
    """Return how long the skills of a plan take as planned; None if an engine planned them.

    Parameters
    ----------
    task
        Whose plan it is.
    skills
        The plan, each applicable when its turn comes, and with one motion at most.
    timed_by
        Names of the detectors that plan trajectories, by commas; empty for travel by the task.
    options
        Option values by plugin.

    Raises
    ------
    OptionError
        If a detector refuses the task or an option is wrong.
    BackEndError
        If a back end fails.
    """
    names = tuple(filter(None, timed_by.split(",")))
    if not set(names) <= set(registry.names("collision")):
        return None
    setup = Setup(DEFAULT_PHYSICS, names, options)
    back_ends = introduce(setup.back_ends(task)) if names else []
    model, state, durations_s = make_model(task, setup, back_ends=back_ends), task.initial, []
    for skill in skills:
        durations_s.append(model.duration_s(state, skill))
        state = skill.prediction_in(state).apply(state)
    return PlannedTimes(durations_s, timed_by)


def geometric_chart(
    task: Task, setup: Setup, cache: VerdictCache | None = None
) -> tuple[DerivedChart, tuple[str, ...]]:
    """Return the relation that detectors of collisions give, and the names of the back ends.

    Parameters
    ----------
    task
        With bodies.
    setup
        Its detectors are queried where it names any; else the swept motions, or boxes where those
        are not installed or do not serve the task. No engine executes anything unless it is named.
    cache
        Where verdicts are kept; a fresh one in memory by default.

    Raises
    ------
    OptionError
        If a detector that was named refuses the task.
    BackEndError
        If a back end fails.
    """
    chosen = replace(
        setup, physics=setup.physics or DEFAULT_PHYSICS, screening=False, with_chart=False
    )
    tried = [chosen.collision] if chosen.collision else [(SCREEN,), (BOXES,)]
    if not chosen.collision and not chosen.has_screen(task):
        tried = [(BOXES,)]
    for names in tried:
        try:
            made = replace(chosen, collision=names).back_ends(task)
            break
        except OptionError:
            if names == tried[-1]:
                raise
    kept = VerdictCache() if cache is None else cache
    with closing(make_feasibility(task, chosen, kept, back_ends=made)) as feasibility:
        chart = derive_chart(feasibility)
        return chart, tuple(back_end.name for back_end in feasibility.back_ends)
