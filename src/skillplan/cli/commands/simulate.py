"""``skillplan simulate``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from skillplan.cli.load import load_file, load_result, make_setup
from skillplan.cli.options.completion import engine_names, plugin_options, task_files
from skillplan.cli.options.shared import (
    BACK_ENDS,
    OUTPUT,
    RESULT_HELP,
    TASK,
    BackEnds,
    CommandLimits,
    PartReading,
    Style,
)
from skillplan.cli.options.values import positive_number

if TYPE_CHECKING:  # --help pays for no imports
    from contextlib import AbstractContextManager
    from pathlib import Path

    from skillplan.cli.interruption import Count
    from skillplan.physics.performance import Angle, Performance, Sample
    from skillplan.pipeline.setup import Setup
    from skillplan.task.skill import Skill
    from skillplan.task.task import Task


def command(
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK|RESULT",
            autocompletion=task_files,
            help=f"A task file; or {RESULT_HELP}.",
            show_default=False,
        ),
    ],
    reading: PartReading,
    limits: CommandLimits,
    sequence: Annotated[
        str | None,
        typer.Option(
            "--sequence",
            metavar="0,1,4,...",
            help="The plan of TASK: action numbers or skill names, separated by commas, or @ and "
            "a file with a plan. RESULT holds its own.",
            rich_help_panel=TASK,
        ),
    ] = None,
    physics: Annotated[
        str | None,
        typer.Option(
            "--physics",
            metavar="NAME",
            autocompletion=engine_names,
            help="An engine that moves bodies, or auto: pybullet where it is installed, else "
            "mujoco; default: the task file's choice, or else auto.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = None,
    options: Annotated[
        list[str] | None,
        typer.Option(
            "-O",
            metavar="KEY=VALUE",
            autocompletion=plugin_options,
            help="Option of the engine, or of the detector whose limits hold for contacts, as "
            "PLUGIN.KEY=VALUE; 'skillplan plugins KIND NAME' lists them. May be repeated.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = None,
    video: Annotated[
        str | None,
        typer.Option(
            "--video",
            metavar="FILE",
            help="Film it, as .gif or .mp4. What was there is replaced.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    fps: Annotated[
        float,
        typer.Option(
            "--fps",
            parser=positive_number(50),
            metavar="N",
            help="Pictures a second of the video.",
            rich_help_panel=OUTPUT,
        ),
    ] = 12.5,
    speed: Annotated[
        float,
        typer.Option(
            "--speed",
            parser=positive_number(1000),
            metavar="X",
            help="How many simulated seconds the video shows in a second.",
            rich_help_panel=OUTPUT,
        ),
    ] = 1.0,
    trace: Annotated[
        str | None,
        typer.Option(
            "--trace",
            metavar="FILE",
            help="Where hand and bodies were, 60 rows a simulated second, as .csv. What was there "
            "is replaced.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            "--camera",
            metavar="ANGLE",
            help="From where it is filmed: front, side, top, or AZIMUTH,ELEVATION,DISTANCE in "
            "degrees and m; arm and board are in the picture. By default from a corner.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    labels: Annotated[
        bool,
        typer.Option(
            "--labels",
            help="Film it with name tags at bodies, feeders and docks.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    style: Style = "table",
) -> int:
    """Execute a whole plan of TASK, or that of RESULT, in one continuous simulated world.

    Says how each skill went, what was sensed, and how far from its goal every body ended. From
    what force on a contact is a collision, say the detectors that read contacts, with the options
    of the task file or of RESULT; where none is chosen, contact-pairs. Of a skill with several
    ways, that of RESULT is executed, or else the first that the engine grants. The plan ends at
    the first skill that fails; Ctrl-C and --time-limit end it after the current skill.
    """
    import time
    from contextlib import ExitStack

    from skillplan.checks.single_check import introduce
    from skillplan.cli.interruption import counting
    from skillplan.cli.output import emit
    from skillplan.cli.showing import blamed, performer
    from skillplan.errors import exit_code
    from skillplan.files.output_path import output_path
    from skillplan.pipeline.performing import by_ways, planned_times
    from skillplan.records.execution.simulation import SUFFIXES, Simulation, applicable_part
    from skillplan.views.tables.trials import simulation_tables
    from skillplan.views.video_file import VIDEOS, video_file

    deadline = limits.begin(graceful=True)
    back_ends = BackEnds(physics, None, options or [])
    loaded, setup, skills, ways, _, timing = _load(task, sequence, back_ends, reading)
    made = introduce(setup.back_ends(loaded))
    engine = performer(made, "move")
    possible, obstacle = applicable_part(loaded, skills)
    film = None if video is None else output_path("--video", video, VIDEOS, "videos")
    angle = _angle(camera)
    table = None if trace is None else output_path("--trace", trace, SUFFIXES, "traces")
    with ExitStack() as stack:
        show = None
        if film is not None:
            show = stack.enter_context(video_file(film, fps, "--video")).add
        row = None if table is None else stack.enter_context(_trace(table, loaded))
        count = stack.enter_context(counting("skills", len(skills)))
        stack.enter_context(deadline.calling(count.stop))
        with blamed(engine):
            taken = by_ways(loaded, possible, made, ways, lambda: count.interrupted)
        planned = planned_times(loaded, taken, *timing)
        begin_s = time.perf_counter()
        rate = fps / speed if show is not None else None
        pictures = {"frames_per_s": rate, "show": show, "angle": angle, "labels": labels}
        performance = _perform(engine, taken, count, row, **pictures)
        wall_s = time.perf_counter() - begin_s
        stopped = count.interrupted and len(performance.skills) < len(possible)
    files = {"video": film, "trace": table}
    simulation = Simulation(
        loaded,
        skills,
        setup.physics_choice(loaded).name,
        performance,
        wall_s,
        stopped,
        {option: str(path) for option, path in files.items() if path is not None},
        obstacle,
        planned,
    )
    good = simulation.feasible and simulation.complete and not stopped
    emit(style, simulation.document(), simulation_tables(simulation), failed=not good)
    return exit_code(interrupted=stopped and not deadline.tell_if_over(), solved=good)


def _perform(
    engine: Any,
    skills: Sequence[Skill],
    count: Count,
    row: Callable[[Sample], None] | None,
    **pictures: Any,
) -> Performance:
    """Have an engine perform a plan, which may be empty; `pictures` are for its films."""
    from skillplan.cli.showing import blamed
    from skillplan.physics.performance import Performance

    if not skills:
        return Performance((), (), 0.0, 0)
    note = _Notes(count, row)
    with blamed(engine):
        made: Performance = engine.perform(
            skills, note=note, stopped=lambda: count.interrupted, **pictures
        )
    return made


class _Notes:
    """Counts the skills that are over, and writes every sample into the trace, if there is one."""

    def __init__(self, count: Count, row: Callable[[Sample], None] | None) -> None:
        self._count, self._row = count, row
        self._under_way = ""

    def __call__(self, sample: Sample) -> None:
        """Take note of a sample."""
        # While the world settles no skill is executed.
        if sample.skill and sample.skill != self._under_way:
            if self._under_way:
                self._count.one_more()
            self._under_way = sample.skill
        if self._row is not None:
            self._row(sample)


def _load(path: str, sequence: str | None, back_ends: BackEnds, reading: PartReading) -> _Read:
    """Return task, setup and plan; of engines the one chosen, or the file's, or else pybullet."""
    from skillplan.errors import OptionError
    from skillplan.pipeline.exchange import given_plan
    from skillplan.pipeline.performing import ANY_DETECTOR, contact_detectors
    from skillplan.pipeline.setup import Setup
    from skillplan.records.stored.result_folder import is_result

    stored = is_result(path)
    if stored and sequence is not None:
        raise OptionError("--sequence is for a task file; a result holds its own plan.")
    if not stored and sequence is None:
        raise OptionError("Give the plan by --sequence, or a RESULT in the place of TASK.")

    def read(chosen: BackEnds, *, warn: bool) -> _Read:
        if stored:
            loaded = load_result(path, reading, chosen)
            task, plan = loaded.planned()
            detectors = loaded.stored.collision.split(",")
            skills = task.parse_sequence(",".join(plan))
            timing = loaded.stored.timed_by, loaded.origin.options
            return _Read(task, loaded.setup, skills, loaded.taken_ways(), detectors, timing)
        task = load_file(path, reading, chosen, warn=warn).part(reading.part)
        detectors = [choice.name for choice in task.collision]
        setup = make_setup(chosen, task)
        timing = Setup().timed_by(task), {}
        return _Read(task, setup, given_plan(sequence or "", task), (), detectors, timing)

    # Of the detectors that the file chooses only those need to be installed that read contacts,
    # and which these are the engine says.
    first = read(replace(back_ends, collision=ANY_DETECTOR, options=[]), warn=False)
    engine = _engine(first)
    collision = ",".join(contact_detectors(engine, first.detectors)) or ANY_DETECTOR
    return read(replace(back_ends, physics=engine, collision=collision), warn=True)


class _Read(NamedTuple):
    """A plan as it was read, its ways, the detectors of task or result, and its timers."""

    task: Task
    setup: Setup
    skills: tuple[Skill, ...]
    ways: tuple[str | None, ...]
    detectors: list[str]
    timing: tuple[str, Mapping[str, Mapping[str, Any]]]


def _engine(read: _Read) -> str:
    """Return the name of the engine chosen, or the file's, or else an installed one."""
    from skillplan.errors import OptionError
    from skillplan.pipeline.performing import performing_engine
    from skillplan.plugins.installed import PREFERRED

    if read.setup.physics is not None or read.task.physics is not None:
        return read.setup.physics_choice(read.task).name
    able = performing_engine()
    if able is None:
        raise OptionError(
            f"simulate needs an engine that moves bodies, such as {PREFERRED[0]!r}: "
            f"pip install skillplan-{PREFERRED[0]}."
        )
    return able


def _trace(table: Path, task: Task) -> AbstractContextManager[Callable[[Sample], None]]:
    """Return the file that every sample is written to."""
    from skillplan.records.execution.simulation import trace_file

    return trace_file(table, [body.name for body in task.scene.bodies], "--trace")


def _angle(camera: str | None) -> Angle | None:
    """Return from which side is filmed.

    Raises
    ------
    OptionError
        If that is no angle.
    """
    from skillplan.errors import OptionError
    from skillplan.physics.performance import Angle

    try:
        return None if camera is None else Angle.parse(camera)
    except ValueError as error:
        raise OptionError(f"--camera: {error}") from None
