"""What the pages of the documentation show, and whether it is what the program does.

A page is a Markdown file. These of its fences take part, in the order of the page, in one folder:

- ``console``: each line that begins with ``$`` is a command, what follows is what it prints. A line
  ``...`` stands for any lines. With ``slow`` behind it, only ``make test-all`` runs it.
- any language with ``file=NAME`` behind it: the fence is written to that file.
- ``python run``: is executed, all of a page in one namespace; a fence ``text output`` right after
  it is what it prints. With ``needs=MODULE`` behind it, only if the module is installed; with
  ``slow``, as a console.
"""

import contextlib
import importlib.util
import io
import os
import re
import shlex
import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(
        page
        for page in sorted((ROOT / "docs").rglob("*.md"))
        if "_build" not in page.relative_to(ROOT).parts
    ),
]
FENCE = re.compile(
    r"^(?P<ticks>`{3,})(?P<info>[^`\n]*)\n(?P<body>.*?)^(?P=ticks)[ ]*$", re.M | re.S
)
# pybullet has wheels up to CPython 3.11 only.
HAS_PYBULLET = sys.version_info < (3, 12)


@dataclass
class Fence:
    """A fenced block of a page: its language, the words behind it, its text and where that is."""

    language: str
    words: list[str]
    body: str
    start: int
    end: int

    @property
    def file(self):
        """The file that it is written to, or None."""
        named = [word.removeprefix("file=") for word in self.words if word.startswith("file=")]
        return named[0] if named else None

    @property
    def executable(self):
        """Whether it is Python to execute, and the module that it needs is installed."""
        needs = [word.removeprefix("needs=") for word in self.words if word.startswith("needs=")]
        return (
            self.language == "python"
            and "run" in self.words
            and all(importlib.util.find_spec(module) for module in needs)
        )

    @property
    def slow(self):
        """Whether it takes long."""
        return "slow" in self.words


def fences(text):
    """Return the fenced blocks of a page."""
    results = []
    for match in FENCE.finditer(text):
        language, *words = match["info"].split() or [""]
        results.append(Fence(language, words, match["body"], *match.span("body")))
    return results


@dataclass
class Difference:
    """A command that prints something else than the page shows."""

    command: str
    shown: list[str]
    printed: list[str]


@dataclass
class Session:
    """One page, followed from top to bottom.

    Parameters
    ----------
    page
        The Markdown file.
    with_slow
        Whether slow fences are executed, too.
    """

    page: Path
    with_slow: bool
    differences: list[Difference] = field(default_factory=list)

    def follow(self):
        """Do in the present folder what the page shows; return the page as it should be."""
        text = self.page.read_text("utf-8")
        pieces, done, namespace, printed = [], 0, {"__name__": "page"}, None
        for fence in fences(text):
            body = fence.body
            if fence.file is not None:
                Path(fence.file).write_text(body, "utf-8")
            elif fence.language == "console" and (self.with_slow or not fence.slow):
                body = self._console(body)
            elif fence.language == "python" and "run" in fence.words:
                runs = fence.executable and (self.with_slow or not fence.slow)
                printed = executed(body, namespace) if runs else None
            elif fence.words == ["output"] and printed is not None:
                body = self._held(body.splitlines()[0], body, printed)
            pieces += [text[done : fence.start], body]
            done = fence.end
        return "".join([*pieces, text[done:]])

    def _console(self, body):
        shown = re.split(r"^\$ ", body, flags=re.M)
        assert shown[0] == "", f"{self.page.name}: a console begins with a command: {shown[0]!r}"
        return "".join(self._command(entry) for entry in shown[1:])

    def _command(self, entry):
        command = re.match(r"(?:.*\\\n)*.*\n", entry).group()
        words = shlex.split(command.replace("\\\n", " "))
        if not HAS_PYBULLET and ("pybullet" in command or words[1] == "simulate"):
            return f"$ {entry}"
        return f"$ {command}{self._held(command.strip(), entry[len(command) :], run(words))}"

    def _held(self, what, shown, printed):
        """Return `shown` where `printed` agrees with it, and `printed` where not."""
        if agree(untimed(shown, what), untimed(printed, what)):
            return shown
        self.differences.append(Difference(what, untimed(shown, what), untimed(printed, what)))
        return "".join(f"{line.rstrip()}\n" for line in printed.strip("\n").splitlines())


def run(words):
    """Return what a command prints on stdout and stderr, run in this process."""
    if words[0] == "ls":
        return "".join(f"{path.name}\n" for path in sorted(Path(words[1]).iterdir()))
    assert words[0] == "skillplan", words
    from skillplan.cli import main

    with captured() as stream, contextlib.suppress(SystemExit):
        main(words[1:])
    # As on the machine of a reader, who has not set the variable.
    return read_text(stream).replace(
        os.environ.get("SKILLPLAN_CACHE_DIR", "\0"), "~/.cache/skillplan"
    )


def executed(script, namespace):
    """Return what a Python script prints."""
    with captured() as stream, warnings.catch_warnings():
        warnings.simplefilter("error")
        # Of moviepy, when it is first compiled.
        warnings.filterwarnings("ignore", "invalid escape sequence")
        exec(compile(script, "page", "exec"), namespace)
    return read_text(stream)


@contextlib.contextmanager
def captured():
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
    with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
        yield stream


def read_text(stream):
    stream.flush()
    return stream.buffer.getvalue().decode("utf-8")


def agree(shown, printed):
    """Whether lines are the same, where a line ``...`` stands for any."""
    if "..." not in shown:
        return shown == printed
    cut = shown.index("...")
    if shown[:cut] != printed[:cut]:
        return False
    rest = shown[cut + 1 :]
    return any(agree(rest, printed[begin:]) for begin in range(cut, len(printed) + 1))


def untimed(text, command):
    """Return lines without trailing blanks, and with what the machine decides masked.

    In tables of a comparison all figures of three or four decimals are seconds. What a simulation
    measures depends, in its last digits, on the order in which a processor adds up.
    """
    lines = [line.rstrip() for line in text.strip().splitlines()]
    lines = [re.sub("─+", "─", line) for line in lines]
    lines = [re.sub(r"\d[\d,]*\.?\d* (s|steps/s|nodes/s|kB|MB)\b", r"# \1", line) for line in lines]
    words = command.split()
    if "pybullet" in command or "simulate" in words:
        lines = [re.sub(r" *-?\d+(\.\d+)?(e-\d+)?\b", " #", line) for line in lines]
    if "cache" in words:
        lines = [re.sub(r"^kept in .*", "kept in #", line) for line in lines]
        lines = [
            re.sub(r" +[\d.,]+(e-\d+)?( [kM]?B| s| min| h)?(?=  |$)", " #", line) for line in lines
        ]
    if "compare" in words or "train" in words or "swarmitfix" in command:
        lines = [re.sub(r" *\b\d+\.\d{3,4}\b", " #", line) for line in lines]
    return lines
