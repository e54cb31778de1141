"""Files of every format, and command lines, spoilt at random by the fuzz tests' mutators."""

from __future__ import annotations

import importlib.util
import json
import random
import shutil
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml
from tally import Tally, guarded_folder, progress, survives

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
QUICK = ("--time-limit", "0.2", "--format", "json")
VALUES: tuple[Any, ...] = (
    *(None, True, "", " ", "~", "a" * 70, "\n", "\x85", "\u2028", "\u202e", "\x1b[31m", "[red]"),
    *("1e999", ".nan", "0x1F", "C1", "C99", "box", "lid", "../a.nc", "left", -0.0, 0, -1, 1, 2),
    *(5e-324, 1e-300, 1e-6, 1e300, 10.0, 100_000, 2**63, 10**40, float("inf"), float("nan")),
    *([], {}, [[]], [[[[[0]]]]], {"": {}}, [0, 0], [0.0, 0.0, 0.0], [1e-6] * 3, [None] * 3),
)
WORDS = (
    *(
        "",
        " ",
        ",",
        "0",
        "-1",
        "0,1",
        "0,,1",
        "99",
        "1e9",
        "1e999",
        "0x1",
        "9" * 5000,
        "nan",
        "-inf",
    ),
    *("pick(box)", "pick(", "exact", "exact,exact", "aabb,precedence", "kinematic", "=", "a.b.c=d"),
    *("exact.max_labels=1", "aabb.tolerance_m=.nan", "exact.=1", "--", "-h", "json", "small.yaml"),
    *("\ud800", "\0", "\n", "\x1b[31m", "\u202e", "%s", "{}", "$(ls)", "..", "assembly", "solver"),
)
TOKENS = (
    b"\0",
    b"\xff",
    b"\r",
    b"-",
    b"1e999",
    b"nan",
    b"9" * 40,
    b"\x1b[31m",
    b"{",
    b"\n\n",
    b",",
)
SOLID = """\
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""
MESH_TASK = (
    "  box: {tool: gripper, mass_kg: 0.1, meshes: [{file: box.obj, scale: 0.05}],\n    start_m"
)


def fuzz_tests() -> ModuleType:
    """Return the module of the fuzz tests, for what it mutates and how."""
    spec = importlib.util.spec_from_file_location("fuzz_tests", TESTS / "test_fuzz.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def spoilt(chance: random.Random, content: bytes) -> bytes:
    """Return bytes of which one to four pieces are cut, doubled, flipped or replaced."""
    made = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(made) + 1)
        end = min(len(made), at + chance.choice((1, 1, 4, 20, 200)))
        match chance.randrange(5):
            case 0:
                del made[at:end]
            case 1:
                made[at:at] = made[at:end]
            case 2:
                made[at:end] = bytes(chance.randrange(256) for _ in range(end - at))
            case 3:
                made[at:at] = chance.choice(TOKENS)
            case _:
                del made[at:]
    return bytes(made)


def spoilt_document(chance: random.Random, content: Any, fuzz: ModuleType) -> Any:
    """Return a copy of a document of which one to three nodes are spoilt."""
    for _ in range(chance.randint(1, 3)):
        paths = list(fuzz.nodes(content))
        if not paths:
            break
        change = chance.choice(("delete", "replace", "insert", "rename", "double"))
        content = fuzz.mutated(content, chance.choice(paths), change, chance.choice(VALUES))
    return content


class Inputs:
    """One way to spoil each kind of input, in a folder that holds a whole one of each.

    Parameters
    ----------
    folder
        Where to work.
    networks
        Whether to train one, and to spoil it.
    """

    def __init__(self, folder: Path, *, networks: bool = True) -> None:
        self.folder, self.fuzz = folder, fuzz_tests()
        (folder / "small.yaml").write_text(self.fuzz.TASK, "utf-8")
        self.sop = (ROOT / "configs" / "ESC12.sop").read_bytes()
        self.starter = folder / "starter.yaml"
        assert 0 == survives("init", "assembly", "--out", self.starter)
        assert 0 == survives("search-optimal", self.starter, "--out", folder / "result")
        self.result = json.loads((folder / "result" / "result.json").read_text("utf-8"))
        self.policy = self._trained() if networks else b""

    def _trained(self) -> bytes:
        learning = ("--runs", "1", "--steps", "100", "--out", self.folder / "run")
        assert survives("train", self.starter, "--solver", "dqn", *learning) in (0, 1)
        return (self.folder / "run" / "runs" / "00" / "last.safetensors").read_bytes()

    def ways(self) -> dict[str, Callable[[random.Random], None]]:
        """Return what does a case of each kind."""
        networks = {"safetensors": self.safetensors} if self.policy else {}
        return {
            "yaml": self.yaml,
            "bench": self.bench,
            "sop": self.sop_file,
            "dxf": lambda chance: self.trajectory(chance, ".dxf"),
            "csv": lambda chance: self.trajectory(chance, ".csv"),
            "g-code": lambda chance: self.trajectory(chance, ".nc"),
            "mesh": self.mesh,
            "json": self.json,
            **networks,
            "command-line": self.command_line,
        }

    def solve(self, path: Path) -> None:
        """Check a file, and solve and replay it where it is valid."""
        if survives("check", path) == 0:
            survives("search-optimal", path, *QUICK)
            survives("evaluate", path, "--sequence", "0,1,0", *QUICK)

    def yaml(self, chance: random.Random) -> None:
        """Spoil nodes of a task, or bytes of it."""
        path = self.folder / "task.yaml"
        if chance.random() < 0.5:
            path.write_bytes(spoilt(chance, self.fuzz.TASK.encode()))
        else:
            made = spoilt_document(chance, self.fuzz.yaml_text(self.fuzz.TASK), self.fuzz)
            text = yaml.safe_dump(made, allow_unicode=True, sort_keys=False)
            path.write_bytes(text.encode("utf-8", "replace"))
        self.solve(path)

    def bench(self, chance: random.Random) -> None:
        """Spoil nodes of a bench."""
        text = self.fuzz.BENCHES[chance.choice(sorted(self.fuzz.BENCHES))]
        made = spoilt_document(chance, self.fuzz.yaml_text(text), self.fuzz)
        path = self.folder / "bench.yaml"
        text = yaml.safe_dump(made, allow_unicode=True, sort_keys=False)
        path.write_bytes(text.encode("utf-8", "replace"))
        self.solve(path)

    def sop_file(self, chance: random.Random) -> None:
        """Spoil bytes of a matrix."""
        path = self.folder / "task.sop"
        path.write_bytes(spoilt(chance, self.sop))
        if survives("check", path) == 0:
            survives("search-optimal", path, *QUICK)

    def trajectory(self, chance: random.Random, suffix: str) -> None:
        """Spoil bytes of a drawing, a table or a program."""
        (self.folder / f"a{suffix}").write_bytes(spoilt(chance, self.fuzz.FILES[suffix]))
        path = self.folder / "drawn.yaml"
        path.write_text(f"kind: swarmitfix\nname: a\ntrajectory: {{file: a{suffix}}}\n", "utf-8")
        self.solve(path)

    def mesh(self, chance: random.Random) -> None:
        """Spoil bytes of a mesh of a part."""
        (self.folder / "box.obj").write_bytes(spoilt(chance, SOLID.encode()))
        old = "  box: {tool: gripper, mass_kg: 0.1, size_m: [0.1, 0.1, 0.02], start_m"
        assert old in self.fuzz.TASK
        path = self.folder / "meshed.yaml"
        path.write_text(self.fuzz.TASK.replace(old, MESH_TASK), "utf-8")
        self.solve(path)

    def json(self, chance: random.Random) -> None:
        """Spoil a result, and verify, replay and explain it."""
        folder = self.folder / "spoilt"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        path = folder / "result.json"
        if chance.random() < 0.3:
            path.write_bytes(spoilt(chance, json.dumps(self.result).encode()))
        else:
            made = spoilt_document(chance, self.result, self.fuzz)
            path.write_text(json.dumps(made), "utf-8")
        task = str(self.starter)
        survives("verify", folder, "--task", task, "--time-limit", "5", "--format", "json")
        survives("evaluate", task, "--from", path, *QUICK)

    def safetensors(self, chance: random.Random) -> None:
        """Spoil the network of a run, and let it act."""
        folder = self.folder / "spoilt-run"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.folder / "run", folder)
        for name in ("last.safetensors", "policy.safetensors"):
            path = folder / "runs" / "00" / name
            if path.exists():
                path.write_bytes(spoilt(chance, self.policy))
        survives("evaluate", folder, "--episodes", "2", "--format", "json")

    def command_line(self, chance: random.Random) -> None:
        """Put options and words together that need not fit."""
        command = chance.choice(sorted(self.fuzz.COMMANDS))
        words = [chance.choice(("small.yaml", *WORDS))]
        for _ in range(chance.randint(0, 3)):
            words += chance.sample(self.fuzz.OPTIONS, 1) if chance.random() < 0.6 else []
            words.append(chance.choice(WORDS))
        with chdir(self.folder):
            survives(command, *self.fuzz.SHORT.get(command, ()), *words)


def mutate(tally: Tally, count: int) -> None:
    """Do so many cases, of all kinds in turn."""
    with guarded_folder() as inside:
        inputs = Inputs(inside)
        for kind, way in inputs.ways().items():
            each = -(-count // len(inputs.ways()))
            progress(f"{kind}: {each} inputs")
            for number in range(each):
                tally.case(kind, number, way)
