"""What is compared between the machines of a cluster."""

import re
import tomllib
from pathlib import Path

from skillplan_ray import LIBRARIES, differences
from skillplan_ray.fingerprint import fingerprint

ROOT = Path(__file__).parents[3]
# Read, write, show and check, or are used by the head alone: no figure of a worker is theirs.
HARMLESS = {
    *(
        "filelock",
        "lazy-loader",
        "matplotlib",
        "networkx",
        "pillow",
        "platformdirs",
        "pydantic",
        "pyyaml",
    ),
    *("rich", "safetensors", "typer"),
    *("cadquery-ocp-novtk", "embreex", "ezdxf", "optuna", "rosbags"),
}


def test_the_same_machine_does_not_differ():
    """What is compared is the same every time."""
    result = fingerprint()
    assert {"processor", "Python", "numpy", "skillplan", "source of skillplan"} <= set(result)
    assert differences(result, fingerprint()) == []


def test_what_differs_is_named():
    """Versions with both, what is missing there, and another source of the same version."""
    here = {"numpy": "2.4.6", "pybullet": "3.2.7", "skillplan": "1", "source of skillplan": "a"}
    there = {"numpy": "2.4.5", "skillplan": "1", "source of skillplan": "b"}
    assert differences(here, there) == [
        "numpy 2.4.5 (here 2.4.6)",
        "pybullet is not installed (here 3.2.7)",
        "another source of skillplan 1",
    ]


def test_every_library_that_a_distribution_needs_is_compared_or_known_to_be_harmless():
    """A new engine is not forgotten."""
    result = set()
    for path in (ROOT / "pyproject.toml", *ROOT.glob("plugins/*/pyproject.toml")):
        for needed in tomllib.loads(path.read_text())["project"]["dependencies"]:
            result |= set(re.findall(r"^[\w.-]+", needed.lower()))
    ours = {name for name in result if name.startswith("skillplan")}
    assert result - ours - HARMLESS <= LIBRARIES
    assert result >= LIBRARIES | HARMLESS
