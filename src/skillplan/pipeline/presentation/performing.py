"""Which engine performs a plan, and who rules on its contacts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from skillplan.checks.single_check import introduce
from skillplan.errors import BackEndError, OptionError, PluginError
from skillplan.physics.performance import MOST_PLAYED_S, Performance, Performer, Sample
from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.taken_ways import by_ways
from skillplan.plugins.blame import blame
from skillplan.plugins.installed import PREFERRED
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.task import Task

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
