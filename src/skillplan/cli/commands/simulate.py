"""``skillplan simulate``."""

from __future__ import annotations

from typing import Any

import click

from skillplan.cli.options import (
    PluginName,
    format_option,
    make_setup,
    part_option,
    set_option,
    settings,
    task_argument,
)

ENGINE = "pybullet"


class _Number(click.ParamType[float]):
    """A number above 0, up to a limit; unlike click's range, no NaN."""

    name = "number"

    def __init__(self, most: float) -> None:
        self.most = most

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number.", param, ctx)
        if not 0 < number <= self.most:
            self.fail(f"must be above 0 and at most {self.most}, not {value}.", param, ctx)
        return number


@click.command("simulate")
@task_argument
@click.option(
    "--sequence",
    metavar="0,1,4,...",
    required=True,
    help="The plan: action numbers or skill names, separated by commas.",
)
@click.option(
    "--physics",
    type=PluginName("physics"),
    metavar="NAME",
    help="An engine that moves bodies; default: the task file's choice, or else pybullet.",
)
@click.option(
    "-O",
    "options",
    metavar="PLUGIN.KEY=VALUE",
    multiple=True,
    help="Option of the engine; 'skillplan plugins physics NAME' lists them. May be repeated.",
)
@click.option(
    "--video",
    metavar="FILE",
    help="Film it, as .gif or .mp4. What was there is replaced.",
)
@click.option(
    "--fps",
    type=_Number(50),
    default=12.5,
    show_default=True,
    metavar="N",
    help="Pictures a second of the video.",
)
@click.option(
    "--speed",
    type=_Number(1000),
    default=1.0,
    show_default=True,
    metavar="X",
    help="How many simulated seconds the video shows in a second.",
)
@click.option(
    "--trace",
    metavar="FILE",
    help="Where hand and bodies were, 60 rows a simulated second, as .csv. What was there is "
    "replaced.",
)
@set_option
@part_option
@format_option
def command(
    task: str,
    sequence: str,
    physics: str | None,
    options: tuple[str, ...],
    video: str | None,
    fps: float,
    speed: float,
    trace: str | None,
    changes: tuple[str, ...],
    part: str | None,
    style: str,
) -> int:
    """Execute a whole plan of TASK in one continuous simulated world.

    Says how each skill went, what was sensed, and how far from its goal every body ended. The
    plan ends at the first skill that fails; Ctrl-C ends it after the skill under way.
    """
    import time
    from contextlib import ExitStack

    from skillplan.cli.counting import counting
    from skillplan.cli.output import emit
    from skillplan.cli.showing import blamed, performer
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED
    from skillplan.files.output_path import output_path
    from skillplan.physics.performance import Performance, Sample
    from skillplan.records.simulation import Simulation, applicable_part
    from skillplan.records.trace_file import SUFFIXES, trace_file
    from skillplan.views.tables.simulation import simulation_tables
    from skillplan.views.video_file import VIDEOS, video_file

    loaded, setup = _load(task, physics, options, changes, part)
    engine = performer(setup.back_ends(loaded), "move")
    skills = loaded.parse_sequence(sequence)
    possible, obstacle = applicable_part(loaded, skills)
    film = None if video is None else output_path("--video", video, VIDEOS, "videos")
    table = None if trace is None else output_path("--trace", trace, SUFFIXES, "traces")
    with ExitStack() as stack:
        show = row = None
        if film is not None:
            show = stack.enter_context(video_file(film, fps, "--video")).add
        if table is not None:
            bodies = [body.name for body in loaded.scene.bodies]
            row = stack.enter_context(trace_file(table, bodies, "--trace"))
        count = stack.enter_context(counting("skills", len(skills)))
        under_way: list[str] = []

        def note(sample: Sample) -> None:
            # While the world settles no skill is under way.
            if sample.skill and under_way[-1:] != [sample.skill]:
                if under_way:
                    count.one_more()
                under_way.append(sample.skill)
            if row is not None:
                row(sample)

        performance = Performance((), (), 0.0, 0)
        begin_s = time.perf_counter()
        if possible:
            with blamed(engine):
                performance = engine.perform(
                    possible,
                    frames_per_s=fps / speed if show is not None else None,
                    show=show,
                    note=note,
                    stopped=lambda: count.interrupted,
                )
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
    )
    good = simulation.feasible and simulation.complete and not stopped
    emit(style, simulation.document(), simulation_tables(simulation), failed=not good)
    if stopped:
        return EXIT_INTERRUPTED
    return EXIT_SOLVED if good else EXIT_NO_PLAN


def _load(
    path: str,
    physics: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
) -> tuple[Any, Any]:
    """Return task and setup; of engines the one asked for, or the file's, or else pybullet."""
    from skillplan.errors import OptionError
    from skillplan.pipeline import registry
    from skillplan.pipeline.setup import load_problem

    # Detectors are not asked: the engine itself says what touches. Of those that the file
    # chooses none needs to be installed.
    asked = {"collision": ["aabb"], **({} if physics is None else {"physics": [physics]})}
    loaded = load_problem(path, asked, settings(changes)).part(part)
    if physics is None and loaded.physics is None:
        if ENGINE not in registry.names("physics"):
            raise OptionError(
                f"simulate needs an engine that moves bodies, such as {ENGINE!r}: "
                f"pip install skillplan-{ENGINE}."
            )
        physics = ENGINE
        loaded = load_problem(path, {**asked, "physics": [physics]}, settings(changes)).part(part)
    return loaded, make_setup(physics, "aabb", options)(loaded)
