"""Drawing of checks by engines and detectors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skillplan.collision.hulls import HullDetector, HullScene
from skillplan.errors import BackEndError, OptionError
from skillplan.files.output_path import check_output_path
from skillplan.physics.engine import Engine
from skillplan.physics.performance import Image, Performer
from skillplan.pipeline.performing import find_performing_engine
from skillplan.plugins.blame import blame
from skillplan.plugins.installed import PREFERRED
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.views.video_file import ANIMATIONS, PICTURES, open_video, save_picture

# GIFs count in hundredths of a second.
_FRAMES_PER_S = 12.5
PICTURE, ANIMATE = "--picture", "--animate"
NOTHING = "nothing to draw"


def performer(back_ends: Sequence[BackEnd], to: str) -> Any:
    """Return the engine among some back ends, which must move bodies.

    Parameters
    ----------
    back_ends
        Back ends with one engine.
    to
        Verb of the purpose, for messages: ``draw``.

    Raises
    ------
    OptionError
        If it does not; the message names an engine that does.
    """
    engine = next(back_end for back_end in back_ends if isinstance(back_end, Engine))
    if isinstance(engine, Performer):
        return engine
    able = find_performing_engine()
    instead = f"use --physics {able}" if able else f"pip install skillplan-{PREFERRED[0]}"
    raise OptionError(f"physics {engine.name!r} performs no plans with bodies to {to}; {instead}.")


def illustrator(back_ends: Sequence[BackEnd], paths: Mapping[str, Path]) -> Any:
    """Return the back end that draws a check: an engine that moves bodies, or one with hulls.

    Parameters
    ----------
    back_ends
        Back ends with one engine.
    paths
        Files to draw, from `resolve_drawing_paths`; hulls cannot be filmed.

    Raises
    ------
    OptionError
        If no back end can; the message names an engine that could.
    """
    shows = next((back_end for back_end in back_ends if isinstance(back_end, HullDetector)), None)
    moves = any(isinstance(candidate, Performer) for candidate in back_ends)
    if shows is not None and not moves and ANIMATE not in paths:
        return shows
    return performer(back_ends, "draw")


def resolve_drawing_paths(picture: str | None, animation: str | None) -> dict[str, Path]:
    """Return the files to draw, by option.

    Raises
    ------
    OptionError
        If a file cannot be written there.
    """
    paths = {}
    if picture is not None:
        paths[PICTURE] = check_output_path(PICTURE, picture, PICTURES, "pictures")
    if animation is not None:
        paths[ANIMATE] = check_output_path(ANIMATE, animation, ANIMATIONS, "animations")
    return paths


def draw(drawer: Any, skill: Skill, state: State, paths: Mapping[str, Path]) -> dict[str, str]:
    """Draw a check into files, and return their paths by kind.

    Parameters
    ----------
    drawer
        A back end from `illustrator`.
    skill, state
        The skill and its state. Nothing is drawn if the skill cannot begin there or shows nothing.
    paths
        Files from `resolve_drawing_paths`.

    Raises
    ------
    OptionError
        If a file cannot be written.
    BackEndError
        If the engine or detector fails.
    """
    drawn = {option.removeprefix("--"): NOTHING for option in paths}
    if not skill.applicable(state) or skill.motion is None:
        return drawn
    with blamed(drawer):
        if PICTURE in paths:
            try:
                image = _picture(drawer, skill, state)
            except ValueError as error:
                drawn["picture"] = f"{NOTHING}: {error}"
            else:
                save_picture(image, paths[PICTURE], PICTURE)
                drawn["picture"] = str(paths[PICTURE])
        if ANIMATE in paths:
            with open_video(paths[ANIMATE], _FRAMES_PER_S, ANIMATE) as video:
                for image in drawer.footage(skill, state, _FRAMES_PER_S):
                    video.add(image)
                    drawn["animate"] = str(paths[ANIMATE])
    return drawn


def _picture(drawer: Any, skill: Skill, state: State) -> Image:
    """Return the picture of an engine, or that of a detector's hulls."""
    if isinstance(drawer, Performer):
        picture: Image = drawer.picture(skill, state)
        return picture
    from skillplan.views.figures.figure_style import Heading
    from skillplan.views.figures.hulls_figure import draw_hulls, render_image

    scene: HullScene = drawer.hulls(skill, state)
    heading = Heading(f"{drawer.name}: {skill.name}", scene.reason or "feasible")
    return render_image(draw_hulls(scene, heading))


@contextmanager
def blamed(engine: BackEnd) -> Iterator[None]:
    """Raise foreign exceptions as errors that name the engine.

    Raises
    ------
    BackEndError
        In place of any exception that is not an error of the user.
    """
    try:
        yield
    except BaseException as error:
        name = engine.name
        blame(error, type(engine), lambda words: f"Back end {name!r} failed: {words}", BackEndError)
