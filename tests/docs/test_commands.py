"""Every command that README, the pages and the plugins show can be given as it stands.

`test_transcripts.py` executes commands whose output a page shows. Here are the others: all are
parsed in every run, and executed in the slow or the release tests. `shell_commands.py` lists the
commands that cannot be executed, and those whose sizes are reduced.
"""

import contextlib
import re
import shlex
from pathlib import Path

import pytest
import typer

from shell_commands import OTHER_PROGRAMS, read_commands
from skillplan.cli import app
from transcripts import PAGES, ROOT, captured, fences, read_text

READMES = sorted((ROOT / "plugins").glob("*/README.md"))
SHELLS = ("sh", "bash", "shell")
# `skillplan train TASK` in a sentence.
INLINE = re.compile(r"`(skillplan [^`\n]+)`")

# Pages whose commands take a minute or more.
LONG_PAGES = {
    "docs/explanation/benchmarks.md",
    "docs/explanation/reproduction.md",
    "docs/gallery.md",
    "docs/howto/learners.md",
    "docs/howto/output.md",
    "docs/howto/pictures.md",
    "docs/howto/report.md",
    "docs/tutorials/swarmitfix.md",
    "docs/tutorials/training.md",
    "plugins/skillplan-mujoco/README.md",
    "plugins/skillplan-ortools/README.md",
    "plugins/skillplan-pybullet/README.md",
    "plugins/skillplan-simulation/README.md",
}


def named(page):
    return str(page.relative_to(ROOT))


def commands_of(page):
    """Yield the commands of a page, and whether a fence shows their output."""
    for fence in fences(page.read_text("utf-8")):
        if fence.language == "console":
            for line in re.findall(r"^\$ ((?:.*\\\n)*.*\n)", fence.body, re.M):
                yield from ((command, True) for command in read_commands(line))
        elif fence.language in SHELLS:
            yield from ((command, False) for command in read_commands(fence.body))


def parse(words):
    """Parse a command as the program does, without executing it."""
    if words[0] == "--install-completion":
        # Parsing it would install.
        assert "--install-completion" in options_of(app)
        return
    context = None
    name, arguments = "skillplan", list(words)
    command = app
    while True:
        context = command.make_context(name, arguments, parent=context)
        rest = (
            [*context.protected_args, *context.args] if hasattr(context, "protected_args") else []
        )
        if not hasattr(command, "resolve_command") or not rest:
            return
        name, command, arguments = command.resolve_command(context, rest)


@pytest.mark.parametrize("page", [*PAGES, *READMES], ids=named)
def test_every_command_of_a_page_can_be_parsed(page):
    """Commands, options and the values of options exist."""
    faults = []
    for command, _ in commands_of(page):
        if command.program != "skillplan":
            if command.program not in (*OTHER_PROGRAMS, "ls"):
                faults.append(f"{command.text}: {command.program} is none of OTHER_PROGRAMS")
            continue
        try:
            parse(command.words[1:])
        except typer.Exit:
            pass  # such as --help
        except Exception as error:
            if not hasattr(error, "format_message"):
                raise
            faults.append(f"{command.text}: {error.format_message()}")
    assert [] == faults


def test_commands_in_sentences_have_options_that_exist():
    """Their values are placeholders."""
    context = app.make_context("skillplan", ["check", "a.yaml"])
    known = set(app.list_commands(context))
    faults = []
    for page in (*PAGES, *READMES):
        for text in INLINE.findall(page.read_text("utf-8")):
            words = text.split()[1:]
            if words[0].startswith("-"):
                continue
            if words[0] not in known:
                faults.append(f"{named(page)}: {text}")
                continue
            options = options_of(app.get_command(context, words[0]))
            given = {word.partition("=")[0] for word in words if re.match("--?[a-zA-Z]", word)}
            faults += [f"{named(page)}: {text}: {option}" for option in given - options]
    assert [] == faults


def options_of(command):
    """Return the options of a command and of those below it."""
    names = {name for parameter in command.params for name in parameter.opts}
    below = getattr(command, "commands", {}) if command is not app else {}
    return names.union(*(options_of(entry) for entry in below.values()))


def test_scripts_of_the_pages_exist_with_their_options():
    """Long measurements are not executed."""
    faults = []
    for page in PAGES:
        for command, _ in commands_of(page):
            if command.program != "python" or command.words[1].startswith("-"):
                continue
            script = ROOT / command.words[1]
            source = script.read_text("utf-8") if script.exists() else ""
            options = [word for word in command.words[2:] if word.startswith("--")]
            faults += [f"{command.text}: {o}" for o in options if f'"{o}"' not in source]
            faults += [] if source else [f"{command.text}: no such file"]
    assert [] == faults


def test_every_exception_is_of_a_command():
    """No list grows old."""
    import shell_commands

    commands = [command for page in (*PAGES, *READMES) for command, _ in commands_of(page)]
    texts = [command.text for command in commands]
    lists = [
        *shell_commands.ONLY_PARSED,
        *shell_commands.EXIT_CODES,
        *(pattern for pattern, _, _ in shell_commands.REDUCED),
    ]
    assert [] == [pattern for pattern in lists if not any(re.search(pattern, t) for t in texts)]
    programs = {command.program for command in commands}
    assert set() == set(OTHER_PROGRAMS) - programs


def needed_commands(page):
    """Return the commands whose output a page does not show, and those that write what they read.

    `test_transcripts.py` runs the others.
    """
    needed, read = [], []
    for command, shown in reversed(list(commands_of(page))):
        if command.program != "skillplan" or command.only_parsed:
            continue
        words = command.words
        out = words[words.index("--out") + 1].rstrip("/") if "--out" in words else None
        if not shown or (out is not None and any(out in word for word in read)):
            needed.insert(0, command)
            read += words
    return needed


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(
            page,
            marks=pytest.mark.release(reason="a minute; other pages in the whole suite")
            if named(page) in LONG_PAGES
            else pytest.mark.slow(reason="trainings and figures; all commands parse in every run"),
        )
        for page in (*PAGES, *READMES)
        if needed_commands(page)
    ],
    ids=named,
)
def test_every_command_of_a_page_works(page, tmp_path, monkeypatch):
    """In order, in one folder, with what commands above have written."""
    for shown in ("configs", "examples"):
        (tmp_path / shown).symlink_to(ROOT / shown)
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / ".cache"))
    monkeypatch.chdir(tmp_path)
    for fence in fences(page.read_text("utf-8")):
        if fence.file is not None:
            Path(fence.file).write_text(fence.body, "utf-8")
    for command in needed_commands(page):
        with captured() as stream:
            code = app_code(command.reduced[1:])
        printed = read_text(stream)
        assert code in command.expected_codes, f"{shlex.join(command.reduced)}\n{printed[-2000:]}"
        if command.stdout is not None:
            Path(command.stdout).write_text(printed, "utf-8")


def app_code(words):
    """Return the exit code of a command, run in this process."""
    from skillplan.cli import main

    with contextlib.suppress(SystemExit):
        try:
            main(words)
        except SystemExit as end:
            return end.code
    return 0
