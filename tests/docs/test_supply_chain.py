"""What is installed with skillplan: licences and hashes are known of all that is named."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "docs" / "_ext"), str(ROOT / ".ci")]

import generated_reference  # noqa: E402
import hashes  # noqa: E402
import licences  # noqa: E402


def pinned() -> dict[str, str]:
    """Return the versions of ``constraints.txt``, by name."""
    text = (ROOT / "constraints.txt").read_text("utf-8")
    findall = re.findall(r"(?m)^([\w.-]+)==(\S+)$", text)
    return {licences.canonical(name): version for name, version in findall}


def hashed() -> dict[str, str]:
    """Return the versions of the list of hashes, by name."""
    findall = re.findall(r"(?m)^(\S+)==(\S+) --hash=sha256:[0-9a-f]{64}$", hashes.LIST.read_text())
    return {licences.canonical(name): version for name, version in findall}


def test_every_dependency_stands_with_its_licence():
    """Those of the core and the plugins; what is installed states one."""
    page = generated_reference.filled((ROOT / "docs/reference/licences.md").read_text("utf-8"))
    rows = {
        licences.canonical(cells[1]): cells[3]
        for cells in ([cell.strip() for cell in line.split("|")] for line in page.splitlines())
        if len(cells) == 6
    }
    direct = {name for name, by in licences.direct().items() if any("[" not in item for item in by)}
    assert {"numpy", "torch", "ezdxf"} <= direct
    assert set() == direct - set(rows)
    assert [] == [name for name in direct if rows[name] in ("", "not stated; see its files")]


def test_the_list_of_hashes_has_the_versions_of_the_constraints():
    """All that is pinned of it, and all that the core and the plugins but torch name."""
    versions = pinned()
    assert {} == {
        name: version
        for name, version in hashed().items()
        if name in versions and versions[name] != version
    }
    named = {
        licences.canonical(re.split(r"[<>=!~ \[;]", requirement)[0])
        for requirement in hashes.requirements()
    }
    # What only one extra shows, and nothing of ours imports, is not in the list.
    assert set() == named - set(hashed())


def test_what_is_trusted_is_said_where_it_is_looked_for():
    """At the root, and among the explanations, with the same words for malice."""
    for path in ("SECURITY.md", "docs/explanation/trust.md"):
        text = " ".join((ROOT / path).read_text("utf-8").split())
        assert "skillplan verify` in a fresh" in text
        assert "replace the referee" in text
