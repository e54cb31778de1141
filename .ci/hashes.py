"""Write the SHA-256 of every wheel that an installation is made of, as pip reports it.

For CPython 3.11 on Linux x86-64, in the versions of ``constraints.txt``: the core with its extras,
the plugins but for torch, and what builds. ``make hashes`` runs it.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIST = ROOT / ".ci" / "hashes-linux-x86_64-py311.txt"
BUILDING = ["hatchling", "editables"]
# Its builds without CUDA come from an index of its own, with hashes of their own.
LEFT_OUT = {"skillplan-torch"}
HEAD = """\
# SHA-256 of what `make hashes` found for CPython 3.11 on Linux x86-64; docs/explanation/trust.md
# says how to use it. Made by .ci/hashes.py; not edited by hand.
"""


def requirements() -> list[str]:
    """Return all that the core, its extras and the plugins name."""
    found = list(BUILDING)
    for path in [ROOT / "pyproject.toml", *sorted(ROOT.glob("plugins/*/pyproject.toml"))]:
        project = tomllib.loads(path.read_text("utf-8"))["project"]
        if project["name"] in LEFT_OUT:
            continue
        extras = project.get("optional-dependencies", {}).values()
        found += [*project["dependencies"], *(one for extra in extras for one in extra)]
    return sorted({one for one in found if not one.startswith("skillplan")})


def main() -> int:
    """Ask pip, which downloads what its index gives no hash of; write the list."""
    if sys.version_info[:2] != (3, 11) or sys.platform != "linux":
        print("The list is for CPython 3.11 on Linux; run this there.", file=sys.stderr)
        return 2
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    words = ["--dry-run", "--ignore-installed", "--only-binary", ":all:", "--report", "-"]
    words += ["--constraint", str(ROOT / "constraints.txt"), *requirements()]
    done = subprocess.run([*pip, *words], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        return done.returncode
    lines = []
    for one in json.loads(done.stdout)["install"]:
        about, info = one["metadata"], one["download_info"]["archive_info"]
        lines.append(
            f"{about['name']}=={about['version']} --hash=sha256:{info['hashes']['sha256']}"
        )
    LIST.write_text(HEAD + "".join(f"{line}\n" for line in sorted(lines, key=str.lower)), "utf-8")
    print(f"{LIST.relative_to(ROOT)}: {len(lines)} distributions")
    return 0


if __name__ == "__main__":
    sys.exit(main())
