"""Videos: what is filmed is what is shown, for as long, and a file is there whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image as PillowImage

from example_count import examples
from skillplan.errors import OptionError
from skillplan.physics import Image
from skillplan.views import open_video, save_picture


def plain(colour: int, width: int = 6, height: int = 4) -> Image:
    """Return a picture of one grey."""
    return Image(width, height, bytes([colour]) * (3 * width * height))


def shown(path: Path) -> list[tuple[bytes, int]]:
    """Return the pictures of a GIF, each with how long it is shown [ms]."""
    with PillowImage.open(path) as gif:
        results = []
        for index in range(gif.n_frames):
            gif.seek(index)
            results.append((gif.convert("RGB").tobytes(), gif.info["duration"]))
        return results


@settings(max_examples=examples(40))
@given(st.lists(st.integers(0, 255), min_size=1, max_size=12), st.floats(1, 50))
def test_a_gif_shows_every_picture_as_long_as_it_lasts(tmp_path_factory, colours, frames_per_s):
    """Equal ones in a row are one; the whole lasts as long as all, to a fiftieth of a second."""
    path = tmp_path_factory.mktemp("gif") / "video.gif"
    with open_video(path, frames_per_s, "--video") as video:
        for colour in colours:
            video.add(plain(colour))
    distinct = [
        item for item, before in zip(colours, [None, *colours[:-1]], strict=True) if item != before
    ]
    frames = shown(path)
    assert [bytes([colour]) * 72 for colour in distinct] == [picture for picture, _ in frames]
    lasts_ms = sum(duration for _, duration in frames)
    assert abs(lasts_ms - 1000 * len(colours) / frames_per_s) <= 20 * len(colours)


def test_only_what_changes_is_kept(tmp_path):
    """A small change makes a small picture, and what is shown is the whole."""
    path = tmp_path / "video.gif"
    pixels = bytearray(bytes(item // 600 for item in range(76_800)))
    pictures = []
    for index in range(10):
        pixels[3000 + 30 * index : 3012 + 30 * index] = b"\xff" * 12
        pictures.append(bytes(pixels))
    with open_video(path, 10, "--video") as video:
        video.add(Image(160, 160, pictures[0]))
    alone = path.stat().st_size
    with open_video(path, 10, "--video") as video:
        for picture in pictures:
            video.add(Image(160, 160, picture))
    assert pictures == [picture for picture, _ in shown(path)]
    assert 2 * alone > path.stat().st_size


@pytest.mark.slow(reason="films twice; one film in every run")
@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_equal_pictures_make_equal_files(tmp_path, suffix):
    """Bit for bit."""
    created = []
    for name in ("one", "other"):
        path = tmp_path / f"{name}{suffix}"
        with open_video(path, 10, "--video") as video:
            for colour in range(0, 250, 25):
                video.add(plain(colour, 32, 32))
        created.append(path.read_bytes())
    assert created[0] == created[1]


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_what_breaks_off_leaves_what_was_there(tmp_path, suffix):
    """And nothing beside."""
    path = tmp_path / f"video{suffix}"
    path.write_text("precious")

    def broken() -> None:
        with open_video(path, 10, "--video") as video:
            video.add(plain(1, 32, 32))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        broken()
    assert "precious" == path.read_text()
    assert [path] == list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_without_a_picture_nothing_is_written(tmp_path, suffix):
    """Not even an empty file."""
    with open_video(tmp_path / f"video{suffix}", 10, "--video"):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_file_that_cannot_be_written_is_named(tmp_path, suffix):
    """In one message, with the option."""
    path = tmp_path / "gone" / f"video{suffix}"
    with pytest.raises(OptionError) as raised:  # noqa: SIM117
        with open_video(path, 10, "--video") as video:
            video.add(plain(1, 32, 32))
    assert str(raised.value).startswith(f"--video {path}: cannot be written: ")


def test_mp4_without_its_library_says_what_to_install(tmp_path, monkeypatch):
    """Or to end the name in .gif."""
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with (
        pytest.raises(OptionError, match=r"'skillplan\[video\]', or end the name in \.gif"),
        open_video(tmp_path / "video.mp4", 10, "--video"),
    ):
        pass


def test_a_picture_is_what_was_drawn(tmp_path):
    """To the last byte, as PNG."""
    picture = Image(4, 2, bytes(range(24)))
    save_picture(picture, tmp_path / "moment.png", "--picture")
    with PillowImage.open(tmp_path / "moment.png") as read:
        assert ("PNG", (4, 2), picture.rgb) == (read.format, read.size, read.tobytes())
