"""Prints the list of slow tests: ``python tests/support/list_slow.py > tests/SLOW.md``."""

import contextlib
import io
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("plugins", "tests")
COLUMNS = """
| test | cases | why |
|---|---|---|
"""
SECTIONS = {
    "slow": """\
# What `make test-all` runs beside `make test`

Each claim has a cheaper case, or a cheaper relative, in every run. Besides, property tests draw
more examples here than in every run (`tests/support/example_count.py`).
Printed by `tests/support/list_slow.py`.
""",
    "release": """
# What `make test-release` runs

Each claim has a cheaper case, or a cheaper relative, in `make test-all`. Besides, property tests
draw all their examples.
""",
}


class Collector:
    """Keeps all that is collected."""

    def __init__(self) -> None:
        self.items: list[pytest.Item] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Note them, before those are left out that were not asked for."""
        self.items = [*items]


def listed(items: list[pytest.Item]) -> str:
    """Return the list of those that are slow, with the reason that the mark of each gives."""
    cases: Counter[tuple[str, str, str]] = Counter()
    for item in items:
        for kind in reversed(SECTIONS):
            mark = item.get_closest_marker(kind)
            if mark is not None:
                name = item.nodeid.partition("[")[0].removesuffix("/")
                cases[kind, name, mark.kwargs["reason"]] += 1
                break
    rows = sorted((*key, count) for key, count in cases.items())
    return "".join(
        head
        + COLUMNS
        + "".join(
            f"| `{name}` | {count} | {why} |\n" for of, name, why, count in rows if of == kind
        )
        for kind, head in SECTIONS.items()
    )


def of_this_run(config: pytest.Config) -> str | None:
    """Return the list if this run has collected the whole suite, else nothing."""
    found = config.pluginmanager.get_plugin(Collector.__name__)
    whole = {ROOT / folder for folder in FOLDERS} == {ROOT / word for word in config.args}
    fewer = any(config.getoption(name, default=None) for name in ("ignore", "ignore_glob", "lf"))
    return listed(found.items) if found is not None and whole and not fewer else None


def slow_tests() -> str:
    """Return the list as it stands in ``tests/SLOW.md``."""
    found = Collector()
    words = ["--collect-only", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *FOLDERS]
    with contextlib.chdir(ROOT), contextlib.redirect_stdout(io.StringIO()):
        assert pytest.main(words, plugins=[found]) == pytest.ExitCode.OK
    return listed(found.items)


if __name__ == "__main__":
    sys.stdout.write(slow_tests())
