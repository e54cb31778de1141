"""Prints the list of slow tests: ``python tests/support/list_slow.py > tests/SLOW.md``."""

import contextlib
import io
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HEAD = """\
# What `make test-all` runs beside `make test`

Each claim has a cheaper case, or a cheaper relative, in every run. Besides, property tests draw a
fifth of their examples in every run, and all of them here (`tests/support/example_count.py`).
Printed by `tests/support/list_slow.py`.

| test | cases | why |
|---|---|---|
"""


class Collector:
    """Counts the cases of every slow test, with the reason that its mark gives."""

    def __init__(self) -> None:
        self.cases: Counter[tuple[str, str]] = Counter()

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Note them, before those are left out that were not asked for."""
        for item in items:
            mark = item.get_closest_marker("slow")
            if mark is not None:
                name = item.nodeid.partition("[")[0].removesuffix("/")
                self.cases[name, mark.kwargs["reason"]] += 1


def slow_tests() -> str:
    """Return the list as it stands in ``tests/SLOW.md``."""
    found = Collector()
    words = ["--collect-only", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "tests", "plugins"]
    with contextlib.chdir(ROOT), contextlib.redirect_stdout(io.StringIO()):
        assert pytest.main(words, plugins=[found]) == pytest.ExitCode.OK
    rows = sorted((name, reason, count) for (name, reason), count in found.cases.items())
    return HEAD + "".join(f"| `{name}` | {count} | {reason} |\n" for name, reason, count in rows)


if __name__ == "__main__":
    sys.stdout.write(slow_tests())
