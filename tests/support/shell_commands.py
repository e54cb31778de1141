"""Commands of ``sh`` fences, which show no output: how they are read, and which cannot be run here.

A line such as ``RAY_AUTH_MODE=token skillplan train TASK > FILE   # comment`` is a command; a
backslash continues it on the next line.
"""

import re
import shlex
from dataclasses import dataclass

# Programs that a page may name, with the reason why the tests do not run them.
OTHER_PROGRAMS = {
    "pip": "installs packages; those of the repository are installed where the tests run",
    "python": "long measurements; test_commands.py checks the script and its options",
    "make": "targets of the Makefile, which CI runs",
    "git": "versions of a checkout",
    "pytest": "the tests themselves",
    "tensorboard": "serves a page until it is stopped",
    "ray": "a cluster of several machines",
    "for": "the line before, in four processes",
    "source": "sets up a shell",
    "cp": "copies the template",
    "sudo": "installs packages of the system",
}

# skillplan commands that are only parsed: a pattern of the command, and the reason.
ONLY_PARSED = {
    r"--executor ray": "needs a Ray cluster; tests/cli/test_cli_executor.py has an executor",
    r"--install-completion": "writes to the files of the user's shell",
    r"skillplan import-cad product\.step": "a file of the user",
    r"skillplan import-cad meshes/": "files of the user",
    r"product/product\.yaml": "a task from a file of the user",
}

# Commands that end with another exit code than 0, which their page explains.
EXIT_CODES = {
    r"^skillplan explain .*--after 0,1,10,11,8 ": 1,
}


@dataclass(frozen=True)
class ShellCommand:
    """A command of a page.

    Parameters
    ----------
    text
        The command without comments, on one line.
    words
        Its words without variables and redirection; the first is the program.
    variables
        Variables of the environment that it sets.
    stdout
        File that its output goes to, or None.
    """

    text: str
    words: tuple
    variables: dict
    stdout: str | None

    @property
    def program(self):
        """The program that it runs."""
        return self.words[0]

    @property
    def only_parsed(self):
        """Why it cannot be run here, or None."""
        reasons = [why for pattern, why in ONLY_PARSED.items() if re.search(pattern, self.text)]
        return reasons[0] if reasons else None

    @property
    def expected_code(self):
        """The exit code that its page expects."""
        codes = [code for pattern, code in EXIT_CODES.items() if re.search(pattern, self.text)]
        return codes[0] if codes else 0


def read_commands(body):
    """Return the commands of a fence."""
    commands = []
    for line in body.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        variables = {}
        while re.fullmatch(r"[A-Z_]+=.*", words[0]):
            key, _, value = words.pop(0).partition("=")
            variables[key] = value
        stdout = None
        if ">" in words:
            place = words.index(">")
            stdout = words[place + 1]
            del words[place : place + 2]
        text = re.sub(r"\s+", " ", line.partition(" #")[0]).strip()
        commands.append(ShellCommand(text, tuple(words), variables, stdout))
    return commands
