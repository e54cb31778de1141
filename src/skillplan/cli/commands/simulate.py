"""``skillplan simulate``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from skillplan.cli.load import load_file, load_result, make_setup
from skillplan.cli.options import shared
from skillplan.cli.options.completion import engine_names, plugin_options, task_files
from skillplan.cli.options.shared import RESULT_HELP
from skillplan.cli.options.values import option, positive_number

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
    reading: shared.ResultReading,
    limits: shared.CommandLimits,
    sequence: Annotated[
        str | None,
        option(
            "--sequence 0,1,4,...",
            shared.TASK,
            "The plan of TASK: action numbers or skill names, separated by commas, or "
            "@FILE with a plan. RESULT contains its own plan.",
        ),
    ] = None,
    keep_going: Annotated[
        bool,
        option(
            "--keep-going",
            shared.TASK,
            "Go on after a part failed: it is taken away, as by hand, and the arm begins the next "
            "skill at the end of this one. Default: the plan ends there.",
        ),
    ] = False,
    physics: Annotated[
        str | None,
        option(
            "--physics NAME",
            shared.BACK_ENDS,
            "Engine that moves bodies, or auto: pybullet if it is installed, else mujoco. "
            "Default: the task file's choice, or else auto.",
            autocompletion=engine_names,
        ),
    ] = None,
    options: Annotated[
        list[str] | None,
        option(
            "-O KEY=VALUE",
            shared.BACK_ENDS,
            "Option of the engine, or of the detector that judges contacts, as "
            "PLUGIN.KEY=VALUE; 'skillplan plugins KIND NAME' lists them. May be repeated.",
            autocompletion=plugin_options,
        ),
    ] = None,
    video: Annotated[
        str | None,
        option(
            "--video FILE",
            shared.OUTPUT,
            "Film the simulation as .gif or .mp4; an existing file is replaced.",
        ),
    ] = None,
    fps: Annotated[
        float,
        option(
            "--fps N",
            shared.OUTPUT,
            "Pictures per second of the video.",
            parser=positive_number(50),
        ),
    ] = 12.5,
    speed: Annotated[
        float,
        option(
            "--speed X",
            shared.OUTPUT,
            "Simulated seconds per second of the video.",
            parser=positive_number(1000),
        ),
    ] = 1.0,
    trace: Annotated[
        str | None,
        option(
            "--trace FILE",
            shared.OUTPUT,
            "Write the poses of hand and bodies as .csv, 60 rows per simulated second; an "
            "existing file is replaced.",
        ),
    ] = None,
    camera: Annotated[
        str | None,
        option(
            "--camera ANGLE",
            shared.OUTPUT,
            "View of the film: front, side, top, or AZIMUTH,ELEVATION,DISTANCE in degrees and "
            "m; arm and board are in the picture. Default: from a corner.",
        ),
    ] = None,
    labels: Annotated[
        bool,
        option(
            "--labels", shared.OUTPUT, "Show name tags of bodies, feeders and docks in the film."
        ),
    ] = False,
    style: shared.Style = "table",
) -> int:
    """Execute a whole plan of TASK, or the plan of RESULT, in one continuous simulated world.

    Prints how each skill went, its measurements, and how far every body ended from its goal. The
    detectors that read contacts decide which force is a collision, with the options of the task
    file or of RESULT; the default detector is contact-pairs. If a skill has several variants, the
    one in RESULT is executed, or else the first that the engine accepts. The plan ends at the first
    skill that fails, unless --keep-going takes its part away; Ctrl-C and --time-limit end it after
    the current skill.
    """
    import time
    from contextlib import ExitStack

    from skillplan.checks.single_check import introduce
    from skillplan.cli.interruption import counting
    from skillplan.cli.output import emit
    from skillplan.cli.showing import blamed, performer
    from skillplan.errors import exit_code
    from skillplan.files.output_path import check_output_path
    from skillplan.pipeline.performing import choose_variants, plan_times
    from skillplan.records.execution.simulation import SUFFIXES, Simulation, find_applicable_part
    from skillplan.views.tables.trials import tabulate_simulation
    from skillplan.views.video_file import VIDEOS, open_video

    deadline = limits.begin(graceful=True)
    back_ends = shared.BackEnds(physics, None, options or [])
    loaded, setup, skills, ways, _, timing = _load(task, sequence, back_ends, reading)
    checkers = introduce(setup.back_ends(loaded))
    engine = performer(checkers, "move")
    possible, obstacle = find_applicable_part(loaded, skills)
    film = None if video is None else check_output_path("--video", video, VIDEOS, "videos")
    angle = _parse_angle(camera)
    table = None if trace is None else check_output_path("--trace", trace, SUFFIXES, "traces")
    with ExitStack() as stack:
        show = None
        if film is not None:
            show = stack.enter_context(open_video(film, fps, "--video")).add
        row = None if table is None else stack.enter_context(_open_trace(table, loaded))
        count = stack.enter_context(counting("skills", len(skills)))
        stack.enter_context(deadline.calling(count.stop))
        with blamed(engine):
            taken = choose_variants(loaded, possible, checkers, ways, lambda: count.interrupted)
        planned = plan_times(loaded, taken, *timing)
        begin_s = time.perf_counter()
        rate = fps / speed if show is not None else None
        pictures = {"frames_per_s": rate, "show": show, "angle": angle, "labels": labels}
        pictures["keeps_going"] = keep_going
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
        engine.not_checked(),
    )
    good = simulation.feasible and simulation.complete and not stopped
    emit(style, simulation.document(), tabulate_simulation(simulation), failed=not good)
    return exit_code(interrupted=stopped and not deadline.tell_if_over(), solved=good)


def _perform(
    engine: Any,
    skills: Sequence[Skill],
    count: Count,
    row: Callable[[Sample], None] | None,
    **pictures: Any,
) -> Performance:
    """Let an engine perform a plan, which may be empty; `pictures` are the settings of its film."""
    from skillplan.cli.showing import blamed
    from skillplan.physics.performance import Performance

    if not skills:
        return Performance((), (), 0.0, 0)

    def stopped() -> bool:
        count.one_more()
        return count.interrupted

    with blamed(engine):
        # Samples cost time, so an engine takes none without a trace.
        performance: Performance = engine.perform(skills, note=row, stopped=stopped, **pictures)
    return performance


def _load(
    path: str, sequence: str | None, back_ends: shared.BackEnds, reading: shared.ResultReading
) -> _Read:
    """Read task, setup and plan; the engine is the chosen one, the file's, or pybullet."""
    from skillplan.errors import OptionError
    from skillplan.pipeline.exchange import read_given_plan
    from skillplan.pipeline.performing import ANY_DETECTOR, find_contact_detectors
    from skillplan.pipeline.setup import Setup
    from skillplan.records.stored.result_folder import is_result

    stored = is_result(path)
    if stored and sequence is not None:
        raise OptionError("--sequence is for a task file; a result holds its own plan.")
    if not stored and sequence is None:
        raise OptionError("Give the plan by --sequence, or a RESULT in the place of TASK.")

    def read(chosen: shared.BackEnds, *, warn: bool) -> _Read:
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
        return _Read(task, setup, read_given_plan(sequence or "", task), (), detectors, timing)

    # Only detectors that read contacts need to be installed, and only the engine knows them.
    first = read(replace(back_ends, collision=ANY_DETECTOR, options=[]), warn=False)
    engine = _choose_engine(first)
    collision = ",".join(find_contact_detectors(engine, first.detectors)) or ANY_DETECTOR
    return read(replace(back_ends, physics=engine, collision=collision), warn=True)


class _Read(NamedTuple):
    """A plan, the variants of its skills, the detectors of task or result, and its timers."""

    task: Task
    setup: Setup
    skills: tuple[Skill, ...]
    ways: tuple[str | None, ...]
    detectors: list[str]
    timing: tuple[str, Mapping[str, Mapping[str, Any]]]


def _choose_engine(read: _Read) -> str:
    """Return the name of the engine: the chosen one, the file's, or an installed one."""
    from skillplan.errors import OptionError
    from skillplan.pipeline.performing import find_performing_engine
    from skillplan.plugins.installed import PREFERRED

    if read.setup.physics is not None or read.task.physics is not None:
        return read.setup.physics_choice(read.task).name
    able = find_performing_engine()
    if able is None:
        raise OptionError(
            f"simulate needs an engine that moves bodies, such as {PREFERRED[0]!r}: "
            f"pip install skillplan-{PREFERRED[0]}."
        )
    return able


def _open_trace(table: Path, task: Task) -> AbstractContextManager[Callable[[Sample], None]]:
    """Open the trace file."""
    from skillplan.records.execution.simulation import trace_file

    return trace_file(table, [body.name for body in task.scene.bodies], "--trace")


def _parse_angle(camera: str | None) -> Angle | None:
    """Parse the angle of the camera."""
    from skillplan.errors import OptionError
    from skillplan.physics.performance import Angle

    try:
        return None if camera is None else Angle.parse(camera)
    except ValueError as error:
        raise OptionError(f"--camera: {error}") from None
