"""Build every wheel, install them apart from the sources, solve, report and export with them.

Once with Python 3.11, where every plugin runs, and once with the newest Python that is there, where
those plugins are left out whose own dependencies have no wheels for it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OPTIMUM_M = 1.86709
BENCH = "swarmitfix_polygonal.yaml"
PHYSICS = ("--collision", "contact-pairs", "--physics")
# What is executed in the engine that every Python has, to the last digit the same on each.
EXECUTED = ("place(switch_1)", "--after", "0,1,2", *PHYSICS, "mujoco", "--no-cache")
# What has wheels for CPython 3.11 only, of those that the constraints name.
UP_TO_3_11 = ("skillplan_pybullet", "skillplan_torch")
NEWEST_TRIED = 20
# Built from web/, and not committed.
PLAYER = "skillplan/views/report/player"
PLAYER_FILES = ("player.js", "player.css", "LICENCES.txt")
PLAN = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"


def run(*words: str | Path, cwd: Path, path: str | None = None) -> str:
    """Run a command without the sources on its path; end here, in its words, if it fails.

    Programs that it starts are looked for in `path`, or where this process looks.
    """
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    environment["PIP_CONSTRAINT"] = str(ROOT / "constraints.txt")
    if path is not None:
        environment["PATH"] = path
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


def check_player(folder: Path) -> str:
    """See that the core's wheel and sdist hold the player with its licences; return the script."""
    (wheel,), (sdist,) = folder.glob("skillplan-[0-9]*.whl"), folder.glob("skillplan-[0-9]*.tar.gz")
    with zipfile.ZipFile(wheel) as held, tarfile.open(sdist) as packed:
        root = sdist.name.removesuffix(".tar.gz")
        for name in PLAYER_FILES:
            inside = f"{PLAYER}/{name}"
            if inside not in held.namelist():
                sys.exit(f"dist-check: {wheel.name} has no {inside}; make web builds it")
            if f"{root}/src/{inside}" not in packed.getnames():
                sys.exit(f"dist-check: {sdist.name} has no src/{inside}; make web builds it")
        licences = held.read(f"{PLAYER}/LICENCES.txt").decode()
        if "three" not in licences or "Permission is hereby granted" not in licences:
            sys.exit(
                f"dist-check: {wheel.name}: LICENCES.txt does not hold the licence of three.js"
            )
        return held.read(f"{PLAYER}/player.js").decode()


def check_page(binaries: Path, place: Path, script: str) -> None:
    """See that the installed wheel writes a page with 3-D where no Node is found."""
    bench = place / BENCH
    shutil.copy(ROOT / "configs" / BENCH, bench)
    page = place / "bench.html"
    run(binaries / "skillplan", "report", bench, "--out", page, cwd=place, path=str(binaries))
    text = page.read_text("utf-8")
    if script not in text or "skillplan.playback/1" not in text:
        sys.exit(f"dist-check: the page of {bench.name} has no 3-D playback")
    print(f"the bench's page, without Node: {len(text) / 1e6:.2f} MB, with 3-D")


def check_export(binaries: Path, place: Path, board: Path) -> None:
    """See that a plan is handed over to ROS 2, whose bags are written by a plugin."""
    words = ("export", board, "--sequence", PLAN, "--to", "ros2", "--out", place / "bag")
    run(binaries / "skillplan", *words, cwd=place)
    names = {path.name for path in (place / "bag").iterdir()}
    if names != {"metadata.yaml", "trajectories.mcap"}:
        sys.exit(f"dist-check: the bag holds {', '.join(sorted(names)) or 'nothing'}")
    print("the board's plan as a bag of ROS 2")


def check(
    version: tuple[int, int], python: str, wheels: list[Path], folder: Path, script: str
) -> str:
    """Install the wheels into a fresh environment, and let them solve, report and export there.

    Returns what an execution in MuJoCo left behind.
    """
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
    # What `auto` stands for, and MuJoCo beside it.
    engines = ("auto", "mujoco") if everything else ("auto",)
    physics = tuple((*PHYSICS, engine) for engine in engines)
    for words in ((), ("--collision", "swept"), *physics):
        answer = run(
            binaries / "skillplan", "search-optimal", board, *words, "--format", "json", cwd=place
        )
        result = json.loads(answer)
        if result["status"] != "optimal" or abs(result["cost"] - OPTIMUM_M) > 5e-6:
            sys.exit(f"dist-check: Python {name}: {result['status']} at {result['cost']}")
        if "auto" in words and result["physics"] != ("pybullet" if everything else "mujoco"):
            sys.exit(f"dist-check: Python {name}: auto stood for {result['physics']}")
        by = " ".join(words) or "its own back ends"
        print(f"Python {name}: the board by {by}: optimal at {result['cost']:.5f} m")
    check_page(binaries, place, script)
    check_export(binaries, place, board)
    left_out = sorted({wheel.name.split("-")[0] for wheel in set(wheels) - set(chosen)})
    if left_out:
        print(f"Python {name}: left out, for want of wheels they need: {', '.join(left_out)}")
    told = run(binaries / "skillplan", "explain", board, *EXECUTED, "--format", "json", cwd=place)
    return json.dumps(json.loads(told)["stages"])


def check_core(python: str, wheels: list[Path], folder: Path) -> None:
    """Install the core alone: it solves and reports the board, and names what a bench needs."""
    place = folder / "core"
    place.mkdir()
    run(python, "-m", "venv", place / "venv", cwd=place)
    binaries = place / "venv" / "bin"
    quiet = ("--quiet", "--disable-pip-version-check", "--no-compile")
    (core,) = (wheel for wheel in wheels if wheel.name.startswith("skillplan-"))
    run(binaries / "python", "-m", "pip", "install", *quiet, core, cwd=place)
    board, bench = (ROOT / "configs" / name for name in ("inverter_board.yaml", BENCH))
    answer = run(binaries / "skillplan", "search-optimal", board, "--format", "json", cwd=place)
    if abs(json.loads(answer)["cost"] - OPTIMUM_M) > 5e-6:
        sys.exit("dist-check: the core alone does not find the optimum of the board")
    run(binaries / "skillplan", "report", board, "--out", place / "board.html", cwd=place)
    refused = subprocess.run(
        [binaries / "skillplan", "check", bench], cwd=place, capture_output=True, text=True
    )
    if refused.returncode != 2 or "pip install skillplan-swarmitfix" not in refused.stderr:
        sys.exit(f"dist-check: the core alone says of a bench: {refused.stderr}")
    print("the core alone: the board, and the command that installs the bench")


def main() -> None:
    """Build, install and solve, in a folder that is removed again."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        built = folder / "wheels"
        built.mkdir()
        wheels = build(built)
        print(f"built {', '.join(wheel.name for wheel in wheels)}")
        script = check_player(built)
        print(f"player: {len(script) / 1e6:.2f} MB in wheel and sdist, with its licences")
        check_core(interpreters()[3, 11], wheels, folder)
        told = {
            check(version, python, wheels, folder, script)
            for version, python in interpreters().items()
        }
        if len(told) > 1:
            sys.exit("dist-check: MuJoCo executes a skill differently on another Python")


main()
