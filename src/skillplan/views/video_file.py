"""Images and videos as PNG, GIF and MP4 files, which are written atomically."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Protocol

from skillplan.errors import OptionError
from skillplan.files.atomic_file import replace_file, write_beside, write_whole
from skillplan.files.output_path import report_write_errors
from skillplan.physics.performance import Image
from skillplan.workers.processes import FedProgram

PICTURES = (".png",)
ANIMATIONS = (".gif",)
VIDEOS = (".gif", ".mp4")

# Longest time of an image in a GIF [1/100 s].
_LONGEST_CS = 65_535
# One of the 256 colours is transparent.
_MOST_COLOURS = 255


class Video(Protocol):
    """Receives images of equal size."""

    def add(self, image: Image) -> None:
        """Append an image."""


def save_picture(image: Image, path: Path, option: str) -> None:
    """Write an image as PNG, and replace an old file.

    Raises
    ------
    OptionError
        If it cannot be written; the message begins with the option of the file.
    """
    with report_write_errors(option, path):
        content = io.BytesIO()
        _make_pillow_image(image).save(content, format="PNG", optimize=False)
        write_whole(path, content.getvalue())


@contextmanager
def open_video(path: Path, frames_per_s: float, option: str) -> Iterator[Video]:
    """Open a GIF or an MP4, by the suffix, to which images are added.

    Parameters
    ----------
    path
        Path of the file. An old file is replaced at the end, unless no image was added.
    frames_per_s
        Images per second, in (0, 50] for a GIF.
    option
        Option of the file, for messages.

    Raises
    ------
    OptionError
        If the file cannot be written, or the library for MP4 is not installed.
    """
    with (
        suppress(_Empty),
        report_write_errors(option, path),
        _open_writer(path, frames_per_s, option) as writer,
    ):
        try:
            yield _Guarded(writer, option, path)
        finally:
            writer.close()
        if not writer.has_images:
            raise _Empty


@contextmanager
def _open_writer(path: Path, frames_per_s: float, option: str) -> Iterator[_GifWriter | _Mp4Writer]:
    """Open a writer for the format of the suffix, whose file then replaces `path`."""
    if path.suffix.lower() == ".gif":
        with replace_file(path) as file:
            yield _GifWriter(file, frames_per_s)
    else:
        with write_beside(path) as temporary:
            yield _Mp4Writer(temporary, frames_per_s, option)


class _Empty(Exception):
    """Raised if no image was added; then no file is written."""


class _Guarded:
    """Names the file if an image cannot be written."""

    def __init__(self, writer: Video, option: str, path: Path) -> None:
        self._writer = writer
        self._option = option
        self._path = path

    def add(self, image: Image) -> None:
        """Append an image."""
        with report_write_errors(self._option, self._path):
            self._writer.add(image)


class _GifWriter:
    """Writes a GIF image by image: only changed pixels, with a palette for each image."""

    def __init__(self, file: IO[bytes], frames_per_s: float) -> None:
        self.has_images = False
        self._frames_per_s = frames_per_s
        self._file = file
        self._shown: Any = None
        # RGB pixels, and a mask of the changed ones.
        self._pending: Any = None
        self._begin = 0
        self._count = 0

    def add(self, image: Image) -> None:
        """Append an image."""
        import numpy as np

        pixels = np.frombuffer(image.rgb, np.uint8).reshape(image.height, image.width, 3)
        if self._shown is None:
            self._start(image)
            self._pending = pixels, np.ones(pixels.shape[:2], bool)
        else:
            red, green, blue = np.moveaxis(pixels != self._shown, 2, 0)
            changed = red | green | blue
            if changed.any():
                self._flush()
                self._pending = pixels, changed
        self._shown = pixels
        self._count += 1

    def close(self) -> None:
        """Write the last image."""
        if self.has_images:
            self._flush()
            self._file.write(b";")

    def _start(self, image: Image) -> None:
        self.has_images = True
        size = b"".join(extent.to_bytes(2, "little") for extent in (image.width, image.height))
        # No common palette, and an endless loop.
        self._file.write(b"GIF89a" + size + b"\x00\x00\x00")
        self._file.write(b"!\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")

    def _flush(self) -> None:
        """Write the pending image with its duration."""
        from PIL import GifImagePlugin

        end = round(100 * self._count / self._frames_per_s)
        shown_cs = min(max(end - self._begin, 2), _LONGEST_CS)
        self._begin = end
        colours, corner, transparent = _quantize(*self._pending)
        for block in GifImagePlugin.getdata(
            colours,
            corner,
            duration=10 * shown_cs,
            disposal=1,
            transparency=transparent,
            include_color_table=True,
        ):
            self._file.write(block)


def _quantize(pixels: Any, changed: Any) -> tuple[Any, tuple[int, int], int]:
    """Return the changed part with a palette, its corner, and its transparent colour.

    Parameters
    ----------
    pixels
        RGB pixels, shape (rows, columns, 3).
    changed
        Mask of changed pixels, shape (rows, columns); others are transparent.
    """
    import numpy as np
    from PIL import Image

    rows, columns = (np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0))
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    seen, mask = pixels[part], changed[part]
    own = np.ascontiguousarray(seen[mask])
    few = Image.frombytes("RGB", (len(own), 1), own.tobytes()).quantize(
        _MOST_COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
    palette = (few.getpalette() or [])[: 3 * _MOST_COLOURS]
    transparent = len(palette) // 3
    numbers = np.full(mask.shape, transparent, np.uint8)
    numbers[mask] = np.frombuffer(few.tobytes(), np.uint8)
    image = Image.frombytes("P", (mask.shape[1], mask.shape[0]), numbers.tobytes())
    image.putpalette([*palette, 0, 0, 0])
    return image, (int(columns[0]), int(rows[0])), transparent


class _Mp4Writer:
    """Passes images to ffmpeg: H.264 with even sizes, which all players support."""

    def __init__(self, path: Path, frames_per_s: float, option: str) -> None:
        self.has_images = False
        self._path = path
        self._frames_per_s = frames_per_s
        self._size = (0, 0)
        self._program: FedProgram | None = None
        try:
            import imageio_ffmpeg
        except ImportError:
            raise OptionError(
                f"{option}: MP4 needs imageio-ffmpeg, which is not installed: pip install "
                "'skillplan[video]', or end the name in .gif."
            ) from None
        self._ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()

    def add(self, image: Image) -> None:
        """Append an image."""
        if self._program is None:
            self.has_images = True
            self._size = (image.width - image.width % 2, image.height - image.height % 2)
            self._program = self._start()
        picture = _make_pillow_image(image)
        if picture.size != self._size:
            picture = picture.crop((0, 0, *self._size))
        self._program.feed(picture.tobytes())

    def close(self) -> None:
        """Wait until ffmpeg has finished."""
        if self._program is not None:
            self._program.finish()

    def _start(self) -> FedProgram:
        width, height = self._size
        words = ["-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
        words += ["-s", f"{width}x{height}", "-r", f"{self._frames_per_s:.6f}", "-i", "-"]
        words += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "21"]
        words += ["-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        # Equal images make equal files.
        words += ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-threads", "1"]
        return FedProgram([self._ffmpeg, *words, "-f", "mp4", str(self._path)])


def _make_pillow_image(image: Image) -> Any:
    """Return an image of Pillow."""
    from PIL import Image as PillowImage

    return PillowImage.frombytes("RGB", (image.width, image.height), image.rgb)
