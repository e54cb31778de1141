"""Build every wheel, install them apart from the sources, and solve the board with them.

Once with Python 3.11, where every plugin runs, and once with the newest Python that is there, where
those plugins are left out whose own dependencies have no wheels for it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OPTIMUM_M = 1.86709
BACK_ENDS = ("--physics", "pybullet", "--collision", "contact-pairs")
# What has wheels for CPython 3.11 only, of those that the constraints name.
UP_TO_3_11 = ("skillplan_pybullet", "skillplan_torch")
NEWEST_TRIED = 20


def run(*words: str | Path, cwd: Path) -> str:
    """Run a command without the sources on its path; end here, in its words, if it fails."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    environment["PIP_CONSTRAINT"] = str(ROOT / "constraints.txt")
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=environment, capture_output=True, text=True
    )
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        sys.exit(f"dist-check: failed with {done.returncode}: {' '.join(map(str, words))}")
    return done.stdout


def version_of(python: str) -> tuple[int, int] | None:
    """Return major and minor version of an interpreter, or None where it does not start."""
    code = "import sys; print(*sys.version_info[:2])"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True)
    if done.returncode:
        return None
    major, minor = done.stdout.split()
    return int(major), int(minor)


def interpreters() -> dict[tuple[int, int], str]:
    """Return Python 3.11 and the newest Python of this machine, by version.

    Version managers keep interpreters that are not on the path; those beside the one on the path
    are tried as well.
    """
    names = [f"python3.{minor}" for minor in range(11, NEWEST_TRIED)]
    candidates = [found for name in names if (found := shutil.which(name))]
    siblings = Path(sys.base_prefix).parent
    candidates += [str(path) for path in siblings.glob("3.*/bin/python3")]
    found: dict[tuple[int, int], str] = {}
    for python in candidates:
        version = version_of(python)
        if version is not None and version >= (3, 11):
            found.setdefault(version, python)
    if (3, 11) not in found:
        sys.exit("dist-check: no Python 3.11 here; install one, since every plugin runs on it.")
    return {version: found[version] for version in sorted({(3, 11), max(found)})}


def build(folder: Path) -> list[Path]:
    """Build the core's wheel by way of its sdist, and the plugins' wheels."""
    for source in (ROOT, *sorted((ROOT / "plugins").iterdir())):
        if (source / "pyproject.toml").is_file():
            words = ("-m", "build", "--no-isolation", "--outdir", folder, source)
            run(sys.executable, *words, cwd=folder)
    return sorted(folder.glob("*.whl"))


def check(version: tuple[int, int], python: str, wheels: list[Path], folder: Path) -> None:
    """Install the wheels into a fresh environment, and let the board be solved there."""
    name = ".".join(map(str, version))
    everything = version <= (3, 11)
    chosen = [wheel for wheel in wheels if everything or not wheel.name.startswith(UP_TO_3_11)]
    place = folder / name
    place.mkdir()
    run(python, "-m", "venv", place / "venv", cwd=place)
    binaries = place / "venv" / "bin"
    quiet = ("--quiet", "--disable-pip-version-check", "--no-compile")
    run(binaries / "python", "-m", "pip", "install", *quiet, *chosen, cwd=place)
    board = place / "inverter_board.yaml"
    shutil.copy(ROOT / "configs" / "inverter_board.yaml", board)
    where = run(binaries / "python", "-c", "import skillplan; print(skillplan.__file__)", cwd=place)
    if not Path(where.strip()).is_relative_to(place):
        sys.exit(f"dist-check: skillplan comes from {where.strip()}, not from its wheel")
    listed = json.loads(run(binaries / "skillplan", "plugins", "--format", "json", cwd=place))
    broken = [f"{p['kind']} {p['name']}: {p['problem']}" for p in listed["plugins"] if p["problem"]]
    if broken:
        sys.exit(f"dist-check: broken under Python {name}: {'; '.join(broken)}")
    for words in ((), ("--collision", "swept"), *([BACK_ENDS] if everything else [])):
        answer = run(
            binaries / "skillplan", "search-optimal", board, *words, "--format", "json", cwd=place
        )
        result = json.loads(answer)
        if result["status"] != "optimal" or abs(result["cost"] - OPTIMUM_M) > 5e-6:
            sys.exit(f"dist-check: Python {name}: {result['status']} at {result['cost']}")
        by = " ".join(words) or "its own back ends"
        print(f"Python {name}: the board by {by}: optimal at {result['cost']:.5f} m")
    left_out = sorted({wheel.name.split("-")[0] for wheel in set(wheels) - set(chosen)})
    if left_out:
        print(f"Python {name}: left out, for want of wheels they need: {', '.join(left_out)}")


def main() -> None:
    """Build, install and solve, in a folder that is removed again."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        built = folder / "wheels"
        built.mkdir()
        wheels = build(built)
        print(f"built {', '.join(wheel.name for wheel in wheels)}")
        for version, python in interpreters().items():
            check(version, python, wheels, folder)


main()
