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
    "pytest": "the tests themselves",
    "tensorboard": "serves a page until it is stopped",
    "stat": "a file of the user's account",
    "(umask": "a token for a cluster of several machines",
    "ray": "a cluster of several machines",
    "for": "the line before, in four processes",
}

# Commands of skillplan that are only parsed: a pattern of the command, and the reason.
ONLY_PARSED = {
    r"--executor ray": "needs a Ray cluster; tests/cli/test_cli_engines.py has an executor",
    r"--install-completion": "writes to the files of the user's shell",
    r"import-cad product\.(step|3mf)": "a file of the user; the tutorial imports an example",
    r"import-cad meshes/": "files of the user; the tutorial imports an example",
    r"product/(product\.yaml|relation\.json)": "made of a file of the user; the tutorial does it",
    r"solver greedy": "the plugin that the reader has copied",
}

# Sizes of commands that take minutes: a pattern, its replacement, and the text that allows it.
REDUCED = [
    (r"--trials \d+ --runs \d+", "--trials 4 --runs 1", "any number of trials and runs"),
    (r"--trials \d+", "--trials 4", "any number of trials"),
    (r"-O steps=5000", "-O steps=300", "any number of steps"),
    (r"--steps 60000", "--steps 2000", "any number of steps"),
    (r"--layouts 50", "--layouts 2", "any number of layouts"),
    (r"--runs (10|12|20)\b", "--runs 2", "any number of runs"),
    (r"--steps (10000|6000|5000)\b", "--steps 1500", "any number of steps"),
    (r"--steps 8000", "--steps 1700", "more steps than before"),
    (r"(--preset moller\S*)", r"\1 --runs 1 --steps 500", "a preset, with options after it"),
    (
        r"--solver relational --out",
        "--solver relational -O boards=8 -O rounds=1 -O updates=10 --out",
        "the options of the solver",
    ),
    (r"--video (\S+)", r"--video \1 --fps 2", "any frame rate"),
    (r"gamma=0\.8:0\.999:12", "gamma=0.8:0.999:2", "any number of values"),
]

# Commands that end with another exit code than 0, which their page explains.
EXIT_CODES = {
    r"explain .*place\(transformer\)": 1,
    r"explain .*--from solved --step 9": 1,
    # A plan that is cut short does not reach the goal.
    r"simulate .*--sequence 0,1 ": 1,
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
    def reduced(self):
        """Its words with the sizes of the tests."""
        text = shlex.join(self.words)
        for pattern, less, _ in REDUCED:
            text = re.sub(pattern, less, text)
        return shlex.split(text)

    @property
    def expected_codes(self):
        """The exit codes that are right; a training that is cut short need not complete."""
        codes = [code for pattern, code in EXIT_CODES.items() if re.search(pattern, self.text)]
        cut = self.words[1] == "train" and self.reduced != list(self.words)
        return codes or ([0, 1] if cut else [0])


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
