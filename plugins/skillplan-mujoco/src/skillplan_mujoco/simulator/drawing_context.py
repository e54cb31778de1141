"""Where to draw without a display: a context of OpenGL, by the EGL library of the system."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from typing import Any

# Of EGL's header.
_SURFACELESS, _OPENGL_API, _END = 0x31DD, 0x30A2, 0x3038
_RED, _GREEN, _BLUE, _DEPTH, _SURFACE, _RENDERABLE = 0x3024, 0x3023, 0x3022, 0x3025, 0x3033, 0x3040
# What graphics libraries call their drawing by the processor.
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")
_GL_RENDERER = 0x1F01
# The variable by which MuJoCo is told what to draw with, and its word for EGL.
_CHOICE, _EGL = "MUJOCO_GL", "egl"
_PBUFFER_BIT, _OPENGL_BIT, _DEPTH_BITS, _COLOUR_BITS = 1, 8, 24, 8
_WANTED = (
    *(_RED, _COLOUR_BITS, _GREEN, _COLOUR_BITS, _BLUE, _COLOUR_BITS, _DEPTH, _DEPTH_BITS),
    *(_SURFACE, _PBUFFER_BIT, _RENDERABLE, _OPENGL_BIT, _END),
)


class DrawingContext:
    """A context of OpenGL without a window, by graphics hardware or in software.

    Raises
    ------
    ValueError
        If this machine has none, in words.
    """

    def __init__(self) -> None:
        try:
            egl = ctypes.CDLL("libEGL.so.1")
        except OSError:
            raise ValueError(_instead("no libEGL.so.1")) from None
        pointer = ctypes.c_void_p
        egl.eglGetDisplay.restype = egl.eglGetProcAddress.restype = pointer
        egl.eglCreateContext.restype = pointer
        egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
        egl.eglGetDisplay.argtypes = [pointer]
        egl.eglInitialize.argtypes = [pointer] * 3
        egl.eglChooseConfig.argtypes = [pointer] * 3 + [ctypes.c_int, pointer]
        egl.eglCreateContext.argtypes = egl.eglMakeCurrent.argtypes = [pointer] * 4
        self._egl: Any = egl
        self._display = next((one for one in self._displays() if self._begins(one)), None)
        if self._display is None:
            raise ValueError(_instead("no display of EGL"))
        wanted, found, count = (ctypes.c_int * len(_WANTED))(*_WANTED), pointer(), ctypes.c_int()
        egl.eglChooseConfig(self._display, wanted, ctypes.byref(found), 1, ctypes.byref(count))
        egl.eglBindAPI(_OPENGL_API)
        self._context = egl.eglCreateContext(self._display, found, None, None)
        if not count.value or not self._context:
            raise ValueError(_instead("no OpenGL by EGL"))

    def take_up(self) -> None:
        """Have this thread draw here.

        Raises
        ------
        ValueError
            If it cannot.
        """
        if not self._egl.eglMakeCurrent(self._display, None, None, self._context):
            raise ValueError(_instead("no drawing without a surface by EGL"))

    @property
    def is_software(self) -> bool:
        """Whether the processor draws, which takes ten times as long as graphics hardware."""
        self.take_up()
        address = self._egl.eglGetProcAddress(b"glGetString")
        if not address:
            return True
        name = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(address)(_GL_RENDERER) or b""
        return any(word in name.decode("ascii", "replace").lower() for word in _SOFTWARE)

    def _displays(self) -> list[int | None]:
        """Return displays to be tried: that without a screen, and the one that is there."""
        address = self._egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
        kind = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)
        first = [kind(address)(_SURFACELESS, None, None)] if address else []
        return [*first, self._egl.eglGetDisplay(None)]

    def _begins(self, display: int | None) -> bool:
        return display is not None and bool(self._egl.eglInitialize(display, None, None))


def chosen_context() -> DrawingContext | None:
    """Return what MuJoCo's renderer is to draw with; None where pictures are painted.

    Where nothing else is chosen, graphics hardware draws, if there is any. ``MUJOCO_GL=egl`` has
    the renderer draw without it, too; with any other value pictures are painted.

    Raises
    ------
    ValueError
        If EGL is chosen and not there, in words.
    """
    choice = os.environ.get(_CHOICE, "").lower()
    if choice:
        return drawing_context() if choice == _EGL else None
    try:
        found = drawing_context()
        return None if found.is_software else found
    except ValueError:
        return None


@cache
def drawing_context() -> DrawingContext:
    """Return the process's own, made when it is first needed.

    Raises
    ------
    ValueError
        If this machine has none, in words.
    """
    return DrawingContext()


def _instead(reason: str) -> str:
    return (
        f"MuJoCo has nothing to draw with here ({reason}): install libegl1 and "
        f"libgl1-mesa-dri, or do not set {_CHOICE}"
    )
