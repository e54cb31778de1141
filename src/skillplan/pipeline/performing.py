"""Performing plans with an engine or a motion planner, and deriving a chart from geometry."""

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
from skillplan.model.skill_model import Transition
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


def choose_variants(
    task: Task,
    skills: Sequence[Skill],
    back_ends: Sequence[BackEnd],
    named: Sequence[str | None] = (),
    stopped: Callable[[], bool] = lambda: False,
) -> list[Skill]:
    """Return the skills of a plan, each as the variant that is taken.

    Parameters
    ----------
    task
        The task of the plan.
    skills
        The plan, each skill applicable in its turn.
    back_ends
        Back ends that choose a variant if none is named.
    named
        Labels of the variants by step; None for a skill with a single variant.
    stopped
        Once it returns True, first variants are taken.

    Raises
    ------
    OptionError
        If a skill has no variant of that label.
    BackEndError
        If a back end fails.
    """
    if not any(skill.ways for skill in skills):
        return list(skills)
    feasibility = Feasibility(task, back_ends)
    state, variants = task.initial, []
    for index, skill in enumerate(skills):
        label = named[index] if index < len(named) else None
        if not skill.ways:
            variants.append(skill)
        elif label is not None:
            labels = [way.label for way in skill.ways]
            if label not in labels:
                hint = name_hint(label, labels)
                raise OptionError(f"Step {index + 1}: {skill.name} has no way {label!r}. {hint}")
            variants.append(feasibility.variants.by_label(skill, label))
        elif stopped():
            variants.append(skill.by(skill.ways[0]))
        else:
            variants.append(feasibility.taken(skill, state))
        state = skill.prediction_in(state).apply(state)
    return variants


ANY_DETECTOR = "aabb"
"""A detector that always serves, and that is not queried."""


def find_performing_engine() -> str | None:
    """Return the installed engine that performs plans; None without one."""
    known = registry.names("physics")
    able = (name for name in PREFERRED if name in known)
    return next(
        (name for name in able if issubclass(registry.load("physics", name), Performer)), None
    )


def find_arm_meshes(task: Task, performed_by: str | None) -> Sequence[Path | None]:
    """Return the meshes of base and links of an arm, if an installed engine has them.

    Parameters
    ----------
    task
        A task with the arm as its robot.
    performed_by
        The engine that moved the arm, which is queried first; None for none.
    """
    arm, known = task.scene.robots[0].model, registry.names("physics")
    for name in sorted(set(PREFERRED) & set(known), key=lambda name: name != performed_by):
        try:
            engine = registry.load("physics", name)
        except PluginError:
            # A broken engine must not prevent a page; links are drawn by their collision shapes.
            continue
        looks = engine.looks(arm) if issubclass(engine, Performer) else ()
        if any(looks):
            return looks
    return ()


def find_contact_detectors(engine: str, chosen: Collection[str]) -> list[str]:
    """Return the chosen detectors that judge contacts of an engine, or else its first detector."""
    known = getattr(registry.load("physics", engine), "contact_detectors", ())
    able = [name for name in known if name in registry.names("collision")]
    return [name for name in able if name in chosen] or able[:1]


@dataclass(frozen=True, slots=True)
class Performed:
    """A plan that an engine has performed.

    Parameters
    ----------
    engine
        Name of the engine.
    performance
        The measurements.
    samples
        Rows of the trace; empty for a plan that is too long to be played.
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
    on_begin: Callable[[str], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Performed | str:
    """Perform a plan; return the measurements, or the reason why it cannot be performed.

    Parameters
    ----------
    task
        The task of the plan.
    setup
        Its engine is used if it moves bodies, or else that of `find_performing_engine`.
    skills
        The plan, each skill applicable in its turn.
    ways
        As in `choose_variants`.
    on_begin
        Called with the name of each skill that begins.
    stopped
        Polled; once it returns True, the plan ends after the current skill.

    Raises
    ------
    BackEndError
        If the engine fails.
    """
    named = setup.physics_choice(task).name
    performs = issubclass(registry.load("physics", named), Performer)
    engine = named if performs else find_performing_engine()
    if engine is None:
        known = " or ".join(f"skillplan-{name}" for name in PREFERRED)
        return f"no engine that moves bodies is installed: pip install {known}"
    chosen = [choice.name for choice in setup.named_collision_choices(task)]
    detectors = tuple(find_contact_detectors(engine, chosen)) or (ANY_DETECTOR,)
    taking = replace(setup, physics=engine, collision=detectors, screening=False, with_chart=False)
    try:
        back_ends = introduce(taking.back_ends(task))
    except OptionError as error:
        return str(error)
    performer = _performer(back_ends)
    samples: list[Sample] = []
    under_way = [""]

    def note(sample: Sample) -> None:
        if sample.time_s <= MOST_PLAYED_S:
            samples.append(sample)
        if sample.skill and sample.skill != under_way[0]:
            under_way[0] = sample.skill
            on_begin(sample.skill)

    taken = choose_variants(task, skills, back_ends, ways, stopped)
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


def _performer(back_ends: Sequence[BackEnd]) -> Performer:
    return next(back_end for back_end in back_ends if isinstance(back_end, Performer))


def plan_motion(
    task: Task,
    setup: Setup,
    skills: Sequence[Skill],
    ways: Sequence[str | None] = (),
    *,
    frames_per_s: int,
) -> PlannedMotion | str:
    """Return the poses of arm and parts during a plan, or the reason why they are unknown.

    Parameters
    ----------
    task
        The task of the plan.
    setup
        Holds the options of the motion planner.
    skills
        The plan, each skill applicable in its turn.
    ways
        As in `choose_variants`.
    frames_per_s
        Number of samples per second, >= 1.

    Raises
    ------
    BackEndError
        If the motion planner fails.
    """
    if SCREEN not in registry.names("collision"):
        return "nothing that plans paths is installed: pip install skillplan-pinocchio"
    planning = replace(
        setup, physics=DEFAULT_PHYSICS, collision=(SCREEN,), screening=False, with_chart=False
    )
    try:
        back_ends = introduce(planning.back_ends(task))
    except OptionError as error:
        return str(error)
    plans = next((back_end for back_end in back_ends if isinstance(back_end, MotionPlans)), None)
    if plans is None:
        return f"{SCREEN} tells no paths of whole plans"
    taken = choose_variants(task, skills, back_ends, ways)
    try:
        return plans.planned_motion(taken, frames_per_s)
    except ValueError as error:
        return str(error)
    except BaseException as error:
        blame(
            error, type(plans), lambda words: f"Back end {SCREEN!r} failed: {words}", BackEndError
        )


def plan_times(
    task: Task, skills: Sequence[Skill], timed_by: str, options: Mapping[str, Mapping[str, Any]]
) -> PlannedTimes | None:
    """Return the planned durations of the skills of a plan; None if an engine planned them.

    Parameters
    ----------
    task
        The task of the plan.
    skills
        The plan, each skill applicable in its turn and with one motion at most.
    timed_by
        Names of the detectors that plan trajectories, separated by commas; empty for travel by
        the figures of the task.
    options
        Plugin name to option values.

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
    model, state = make_model(task, setup, back_ends=back_ends), task.initial
    steps: list[Transition] = []
    for skill in skills:
        elapsed_s = sum(step.duration_s for step in steps)
        steps.append(model.transition(state, skill, elapsed_s))
        state = steps[-1].next_state
    durations_s = [step.duration_s for step in steps]
    return PlannedTimes(durations_s, timed_by, [step.wait_s for step in steps])


def derive_geometric_chart(
    task: Task, setup: Setup, cache: VerdictCache | None = None
) -> tuple[DerivedChart, tuple[str, ...]]:
    """Return the precedence relation that geometry gives, and the names of the back ends.

    Parameters
    ----------
    task
        A task with bodies.
    setup
        Its detectors are queried if it names any, or else ``swept``, or ``aabb`` if that is not
        installed or does not serve the task. No engine is queried unless it is named.
    cache
        Verdict cache; by default a new one in memory.

    Raises
    ------
    OptionError
        If a named detector refuses the task.
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
            back_ends = replace(chosen, collision=names).back_ends(task)
            break
        except OptionError:
            if names == tried[-1]:
                raise
    kept = VerdictCache() if cache is None else cache
    with closing(make_feasibility(task, chosen, kept, back_ends=back_ends)) as feasibility:
        chart = derive_chart(feasibility)
        return chart, tuple(back_end.name for back_end in feasibility.back_ends)
