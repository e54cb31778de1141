"""Cases of the campaign by kind, and every failure with the seed that makes it again."""

from __future__ import annotations

import contextlib
import io
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from skillplan.cli import run

DOCUMENTED = {0, 1, 2, 3, 130}
# Longer than any case that is given a limit of its own.
HANG_S = 300


class Hang(BaseException):
    """A case took longer than `HANG_S`; no `Exception`, so that nobody swallows it."""


@dataclass
class Tally:
    """Counts cases, and keeps what failed.

    Parameters
    ----------
    seed
        Of the whole campaign; a case draws from its own, ``SEED:KIND:NUMBER``.
    only
        The seed of the one case that is done again; None for all.
    """

    seed: int
    only: str | None = None
    cases: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def case(self, kind: str, number: int, check: Callable[[random.Random], None]) -> None:
        """Do a case; what it asserts in vain, raises, or hangs on is a failure.

        Parameters
        ----------
        kind, number
            Which case.
        check
            Given chances that this case always has.
        """
        name = f"{self.seed}:{kind}:{number}"
        if self.only is not None and self.only != name:
            return
        self.cases[kind] += 1
        try:
            with watched():
                check(random.Random(name))
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            words = " ".join(str(error).split())[:600]
            self.failures.append(f"{name}  {type(error).__name__}: {words}")

    def text(self) -> str:
        """Return the counts, and every failure in a line."""
        failed = Counter(failure.split(":")[1] for failure in self.failures)
        lines = [f"{'kind':<24}{'cases':>8}{'failed':>8}"]
        lines += [f"{kind:<24}{self.cases[kind]:>8}{failed[kind]:>8}" for kind in self.cases]
        lines.append(f"{'all':<24}{sum(self.cases.values()):>8}{len(self.failures):>8}")
        return "\n".join([*lines, *self.failures, ""])


@contextlib.contextmanager
def watched() -> Iterator[None]:
    """End what hangs."""

    def hang(number: int, frame: FrameType | None) -> None:
        raise Hang(f"still running after {HANG_S} s")

    before = signal.signal(signal.SIGALRM, hang)
    signal.alarm(HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def call(*words: str | Path) -> tuple[int, str]:
    """Run a command line in this process; return its exit code and what stderr shows."""
    out = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True)
    err = io.TextIOWrapper(io.BytesIO(), "utf-8", "backslashreplace", write_through=True)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([str(word) for word in words])
    return code, err.buffer.getvalue().decode()


def survives(*words: str | Path) -> int:
    """Run a command line and hold it to its word: no traceback, a documented exit code."""
    code, message = call(*words)
    holds_to_its_word(code, message)
    return code


def holds_to_its_word(code: int, message: str) -> None:
    """Assert that a command ended as all are documented to."""
    assert "Traceback" not in message, message
    assert "internal error" not in message, message
    # A built-in part that raises is blamed by name, as a plugin is.
    assert "shows the traceback" not in message, message
    assert code in DOCUMENTED, (code, message)
    if code == 2:
        assert message.strip(), "exit code 2 without a word"


@contextlib.contextmanager
def guarded_folder() -> Iterator[Path]:
    """Yield a folder to work in; nothing beside it may change meanwhile."""
    with tempfile.TemporaryDirectory(prefix="campaign-") as name:
        around = Path(name)
        (around / "untouched").mkdir()
        for index in range(3):
            (around / "untouched" / f"{index}.txt").write_text("stays")
        inside = around / "inside"
        inside.mkdir()
        before = contents(around, leaving_out=inside)
        yield inside
        assert before == contents(around, leaving_out=inside), "something outside was touched"


def contents(folder: Path, leaving_out: Path | None = None) -> dict[str, bytes]:
    """Return the files of a folder and of those in it, by their paths from there."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and (leaving_out is None or leaving_out not in path.parents)
    }


def progress(text: str) -> None:
    """Say on stderr what is done now."""
    sys.stderr.write(f"{time.strftime('%H:%M:%S')} {text}\n")
