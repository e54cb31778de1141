"""Pictures and videos of simulated motion as files: PNG, GIF and MP4, there whole or not at all."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Protocol

from skillplan.errors import OptionError
from skillplan.files.atomic_file import replacing, write_whole, written_beside
from skillplan.files.output_path import refusing
from skillplan.physics.performance import Image
from skillplan.workers.program import FedProgram

PICTURES = (".png",)
ANIMATIONS = (".gif",)
VIDEOS = (".gif", ".mp4")

# Longer than this no picture of a GIF is shown [1/100 s].
_LONGEST_CS = 65_535


class Video(Protocol):
    """Takes pictures, all of one size."""

    def add(self, image: Image) -> None:
        """Append a picture."""


def save_picture(image: Image, path: Path, option: str) -> None:
    """Write a picture as PNG, replacing what was there.

    Raises
    ------
    OptionError
        If it cannot be written; the message begins with the option that named the file.
    """
    made = io.BytesIO()
    _pillow(image).save(made, format="PNG", optimize=False)
    with refusing(option, path):
        write_whole(path, made.getvalue())


@contextmanager
def video_file(path: Path, frames_per_s: float, option: str) -> Iterator[Video]:
    """Yield what writes a GIF or an MP4, by the suffix, picture by picture.

    Parameters
    ----------
    path
        What was there is replaced in the end, unless nothing was added.
    frames_per_s
        How many pictures are shown in a second, in (0, 50] for a GIF.
    option
        Which names the file, for messages.

    Raises
    ------
    OptionError
        If the file cannot be written, or an MP4 wants a library that is not installed.
    """
    with suppress(_Empty), refusing(option, path), _writer(path, frames_per_s, option) as writer:
        try:
            yield _Guarded(writer, option, path)
        finally:
            writer.close()
        if not writer.begun:
            raise _Empty


@contextmanager
def _writer(path: Path, frames_per_s: float, option: str) -> Iterator[_GifWriter | _Mp4Writer]:
    """Yield what writes the format that the suffix says, to a file that then replaces `path`."""
    if path.suffix.lower() == ".gif":
        with replacing(path) as file:
            yield _GifWriter(file, frames_per_s)
    else:
        with written_beside(path) as temporary:
            yield _Mp4Writer(temporary, frames_per_s, option)


class _Empty(Exception):
    """Raised where no picture was added, so that nothing is written."""


class _Guarded:
    """Says which file it is that cannot be written."""

    def __init__(self, writer: Video, option: str, path: Path) -> None:
        self._writer = writer
        self._option = option
        self._path = path

    def add(self, image: Image) -> None:
        """Append a picture."""
        with refusing(self._option, self._path):
            self._writer.add(image)


class _GifWriter:
    """Writes a GIF as pictures come: of each only what has changed, with colours of its own."""

    def __init__(self, file: IO[bytes], frames_per_s: float) -> None:
        self.begun = False
        self._frames_per_s = frames_per_s
        self._file = file
        self._shown: Any = None
        self._pending: Any = None
        self._pending_at = (0, 0)
        self._begin = 0
        self._count = 0

    def add(self, image: Image) -> None:
        """Append a picture."""
        from PIL import ImageChops

        picture = _pillow(image)
        if self._shown is None:
            self._start(picture)
            self._pending = picture
        else:
            box = ImageChops.difference(self._shown, picture).getbbox()
            if box is not None:
                self._flush()
                self._pending, self._pending_at = picture.crop(box), box[:2]
        self._shown = picture
        self._count += 1

    def close(self) -> None:
        """Write what is left."""
        if self.begun:
            self._flush()
            self._file.write(b";")

    def _start(self, picture: Any) -> None:
        self.begun = True
        size = b"".join(extent.to_bytes(2, "little") for extent in picture.size)
        # No colours for all pictures, and the whole is shown again and again.
        self._file.write(b"GIF89a" + size + b"\x00\x00\x00")
        self._file.write(b"!\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")

    def _flush(self) -> None:
        """Write the picture that was shown until now, with the time for which it was."""
        from PIL import GifImagePlugin, Image

        end = round(100 * self._count / self._frames_per_s)
        shown_cs = min(max(end - self._begin, 2), _LONGEST_CS)
        self._begin = end
        colours = self._pending.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        for block in GifImagePlugin.getdata(
            colours,
            self._pending_at,
            duration=10 * shown_cs,
            disposal=1,
            include_color_table=True,
        ):
            self._file.write(block)


class _Mp4Writer:
    """Hands pictures to ffmpeg: H.264 with even sizes, which every player shows."""

    def __init__(self, path: Path, frames_per_s: float, option: str) -> None:
        self.begun = False
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
        """Append a picture."""
        if self._program is None:
            self.begun = True
            self._size = (image.width - image.width % 2, image.height - image.height % 2)
            self._program = self._start()
        picture = _pillow(image)
        if picture.size != self._size:
            picture = picture.crop((0, 0, *self._size))
        self._program.feed(picture.tobytes())

    def close(self) -> None:
        """Have ffmpeg finish."""
        if self._program is not None:
            self._program.finish()

    def _start(self) -> FedProgram:
        width, height = self._size
        words = ["-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
        words += ["-s", f"{width}x{height}", "-r", f"{self._frames_per_s:.6f}", "-i", "-"]
        words += ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        # Equal pictures make equal files.
        words += ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-threads", "1"]
        return FedProgram([self._ffmpeg, *words, "-f", "mp4", str(self._path)])


def _pillow(image: Image) -> Any:
    """Return a picture as Pillow has it."""
    from PIL import Image as PillowImage

    return PillowImage.frombytes("RGB", (image.width, image.height), image.rgb)
