"""Render modes of the environments: a line of text, an image, or a window."""

from __future__ import annotations

import importlib
import math
import os
import sys
from collections.abc import Sequence
from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import check_name
from skillplan.errors import OptionError
from skillplan.task.state import State
from skillplan.task.task import Task

RenderMode = Literal["ansi", "human", "rgb_array"]
Frame = NDArray[np.uint8]

# Painters belong to a higher layer, and matplotlib is loaded with the first image.
_PAINTER = "skillplan.views.figures.state_picture"

FRAMES_PER_S = 2
"""Steps per second in windows and videos."""


def check_render_mode(name: str | None) -> RenderMode | None:
    """Return a render mode, or None.

    Raises
    ------
    OptionError
        If the name is unknown, or it is ``human`` and the machine has no display.
    """
    mode: RenderMode | None = None if name is None else check_name("render mode", name, RenderMode)
    if mode == "human" and not _has_display():
        raise _no_window("no display is set")
    return mode


def list_render_modes() -> list[str]:
    """Return the render modes of this machine, for `metadata`: ``human`` only with a display.

    Gymnasium's `check_env` tries every mode that the metadata list.
    """
    modes = get_args(RenderMode)
    return [mode for mode in modes if mode != "human" or _has_display()]


def _has_display() -> bool:
    # SDL itself would open a hidden window without a word.
    variables = ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform != "linux" or any(map(os.environ.get, variables))


def _no_window(reason: str) -> OptionError:
    return OptionError(
        f"render_mode='human': no window can be opened ({reason}). Without a display, use "
        "render_mode='rgb_array'."
    )


def paint_frame(task: Task, state: State, caption: str) -> Frame:
    """Return an image of a state below a caption, shape (480, 640, 3)."""
    frame: Frame = importlib.import_module(_PAINTER).paint_state(task, state, caption)
    return frame


class Window:
    """A window that shows images; pygame opens it with the first one."""

    def __init__(self) -> None:
        self._surface: Any = None
        self._clock: Any = None

    def show(self, frames: Sequence[Frame], title: str) -> None:
        """Show images of equal size, one or several in a grid, and wait for the frame rate.

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            If pygame is not installed.
        OptionError
            If no window can be opened.
        """
        columns = math.ceil(math.sqrt(len(frames)))
        missing = -len(frames) % columns
        shown = [*frames, *[np.full_like(frames[0], 255)] * missing]
        rows = [
            np.concatenate(shown[i : i + columns], axis=1) for i in range(0, len(shown), columns)
        ]
        image = np.concatenate(rows)
        pygame = _import_pygame()
        if self._surface is None:
            self._surface = _open_surface(pygame, (image.shape[1], image.shape[0]))
            pygame.display.set_caption(title)
            self._clock = pygame.time.Clock()
        pygame.surfarray.blit_array(self._surface, image.swapaxes(0, 1))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(FRAMES_PER_S)

    def close(self) -> None:
        """Close the window if it is open."""
        if self._surface is not None:
            _import_pygame().display.quit()
            self._surface = None


def _open_surface(pygame: Any, size_px: tuple[int, int]) -> Any:
    """Return the surface of a new window."""
    try:
        pygame.display.init()
        hidden = pygame.display.get_driver() in ("dummy", "offscreen")
        if os.environ.get("SDL_VIDEODRIVER") or not hidden:
            return pygame.display.set_mode(size_px)
        reason = "SDL finds no display"
    except pygame.error as error:
        reason = str(error).rstrip(".")
    pygame.display.quit()
    raise _no_window(reason)


def _import_pygame() -> Any:
    # Its greeting would be a line of the program's output.
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        return importlib.import_module("pygame")
    except ModuleNotFoundError:
        raise gymnasium.error.DependencyNotInstalled(
            "render_mode='human' opens a window with pygame: pip install pygame-ce"
        ) from None
