"""Files of formats that `tests/test_fuzz.py` leaves out, spoilt at random by its mutators."""

from __future__ import annotations

import gzip
import importlib.util
import json
import os
import random
import re
import shutil
import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from forgeries import SLIPPERY
from tally import Tally, guarded_folder, progress, survives

from urdf_text import urdf

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
QUICK = ("--time-limit", "0.2", "--format", "json")
VALUES: tuple[Any, ...] = (
    *(None, True, "", " ", "~", "a" * 70, "\n", "\x85", "\u2028", "\u202e", "\x1b[31m", "[red]"),
    *("1e999", ".nan", "0x1F", "C1", "C99", "box", "lid", "../a.nc", "left", -0.0, 0, -1, 1, 2),
    *(5e-324, 1e-300, 1e-6, 1e300, 10.0, 100_000, 2**63, 10**40, float("inf"), float("nan")),
    *([], {}, [[]], [[[[[0]]]]], {"": {}}, [0, 0], [0.0, 0.0, 0.0], [1e-6] * 3, [None] * 3),
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
# Kinds of input that take longer get fewer cases at scale 1.
MOST_CASES = 1_000
CASES = {"json": 300, "policies": 200, "urdf": 1_000, "safetensors": 150, "manifest": 60} | {
    "journal": 60,
    "verdict": 60,
    "step": 60,
    "stl": 300,
}
# Kinds that need nothing prepared that takes seconds.
CHEAP = {"sop", "mesh", "json", "urdf", "policies"}
PARTS = ROOT / "plugins" / "skillplan-cad" / "tests" / "fixtures"
STUDY = (
    *("sweep", "--solver", "q-learning", "--sampler", "optuna", "--runs", "1"),
    *("-O", "alpha=0.1:0.5", "-O", "episodes=20"),
)
ARM = """\
kind: assembly
name: arm
robot: {model: arm.urdf, tip: flange, home_m: [0.4, 0.0]}
tools: {t: {holder_m: [0.4, 0.2]}}
initial_tool: t
parts:
  a: {tool: t, size_m: [0.02, 0.02, 0.02], start_m: [0.4, -0.1], goal_m: [0.4, 0.1]}
"""
FEASIBLE = b'"status": "feasible", "reason": ""'
INFEASIBLE = b'"status": "infeasible", "reason": "forged"'
NUMBER = re.compile(r"(?<=: )-?[0-9][0-9.e+-]*")
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
    created = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(created) + 1)
        end = min(len(created), at + chance.choice((1, 1, 4, 20, 200)))
        match chance.randrange(5):
            case 0:
                del created[at:end]
            case 1:
                created[at:at] = created[at:end]
            case 2:
                created[at:end] = bytes(chance.randrange(256) for _ in range(end - at))
            case 3:
                created[at:at] = chance.choice(TOKENS)
            case _:
                del created[at:]
    return bytes(created)


def spoilt_document(chance: random.Random, content: Any, fuzz: ModuleType) -> Any:
    """Return a copy of a document of which one to three nodes are spoilt."""
    for _ in range(chance.randint(1, 3)):
        paths = list(fuzz.nodes(content))
        if not paths:
            break
        change = chance.choice(("delete", "replace", "insert", "rename", "double"))
        content = fuzz.mutated(content, chance.choice(paths), change, chance.choice(VALUES))
    return content


def box_stl(shift_mm: float) -> bytes:
    """Return a cube of 20 mm as a binary STL."""
    x, y, z = ((0.0 + shift_mm, 20.0 + shift_mm), (0.0, 20.0), (0.0, 20.0))
    corners = [(i, j, k) for i in x for j in y for k in z]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [(a, b, c) for a, b, c, _ in faces] + [(a, c, d) for a, _, c, d in faces]
    content = bytes(80) + struct.pack("<I", len(triangles))
    for triangle in triangles:
        values = [0.0, 0.0, 0.0, *(value for index in triangle for value in corners[index])]
        content += struct.pack("<12fH", *values, 0)
    return content


class Inputs:
    """One way to spoil each kind of input, in a folder that holds a whole one of each.

    Parameters
    ----------
    folder
        Where to work.
    whole
        Whether to prepare also what takes seconds: a training, a study and kept verdicts.
    """

    def __init__(self, folder: Path, *, whole: bool = True) -> None:
        self.folder, self.fuzz = folder, fuzz_tests()
        (folder / "small.yaml").write_text(self.fuzz.TASK, "utf-8")
        self.sop = (ROOT / "configs" / "ESC12.sop").read_bytes()
        self.starter = folder / "starter.yaml"
        assert 0 == survives("init", "assembly", "--out", self.starter)
        assert 0 == survives("search-optimal", self.starter, "--out", folder / "result")
        self.result = json.loads((folder / "result" / "result.json").read_text("utf-8"))
        self.urdf, self.arm = urdf(), folder / "arm.yaml"
        self.arm.write_text(ARM, "utf-8")
        (folder / "arm.urdf").write_text(self.urdf, "utf-8")
        assert 0 == survives("check", self.arm)
        (folder / "chance.yaml").write_text(SLIPPERY, "utf-8")
        assert 0 == survives("search-optimal", folder / "chance.yaml", "--out", folder / "policy")
        self.policies = (folder / "policy" / "policies.json").read_bytes()
        self.policy = self._trained() if whole else b""
        if whole:
            self._studied()
            self._filled()

    def _trained(self) -> bytes:
        learning = ("--runs", "1", "--steps", "100", "--out", self.folder / "run")
        assert survives("train", self.starter, "--solver", "dqn", *learning) in (0, 1)
        return (self.folder / "run" / "runs" / "00" / "last.safetensors").read_bytes()

    def _studied(self) -> None:
        """Begin a study whose sampler keeps a journal."""
        words = (*STUDY, self.starter, "--trials", "2", "--out", self.folder / "study")
        assert survives(*words) in (0, 1)

    def _filled(self) -> None:
        """Keep the verdicts of an engine on a board of two parts, and the result with them."""
        self.small_board = self.folder / "two.yaml"
        self.small_board.write_text(SLIPPERY.replace("grasp_failure: 0.3", ""), "utf-8")
        with self._cache("kept"):
            assert 0 == self._by_engine(self.folder / "by-engine")
        document = json.loads((self.folder / "by-engine" / "result.json").read_text("utf-8"))
        self.engine_plan = (document["status"], document["cost"], document["skills"])

    def _by_engine(self, out: Path) -> int:
        engine = ("--physics", "pybullet", "--collision", "contact-pairs")
        return survives("search-optimal", self.small_board, *engine, "--out", out)

    @contextmanager
    def _cache(self, name: str) -> Iterator[None]:
        """Keep verdicts in a folder of its own meanwhile."""
        before = os.environ["SKILLPLAN_CACHE_DIR"]
        os.environ["SKILLPLAN_CACHE_DIR"] = str(self.folder / name)
        try:
            yield
        finally:
            os.environ["SKILLPLAN_CACHE_DIR"] = before

    def ways(self) -> dict[str, Callable[[random.Random], None]]:
        """Return what does a case of each kind."""
        whole = {
            "safetensors": self.safetensors,
            "manifest": self.manifest,
            "journal": self.journal,
            "verdict": self.verdict,
            "step": self.step,
            "stl": self.stl,
        }
        return {
            "sop": self.sop_file,
            "mesh": self.mesh,
            "json": self.json,
            "urdf": self.urdf_file,
            "policies": self.policies_file,
            **(whole if self.policy else {}),
        }

    def solve(self, path: Path) -> None:
        """Check a file, and solve and replay it where it is valid."""
        if survives("check", path) == 0:
            survives("search-optimal", path, *QUICK)
            survives("evaluate", path, "--sequence", "0,1,0", *QUICK)

    def sop_file(self, chance: random.Random) -> None:
        """Spoil bytes of a matrix."""
        path = self.folder / "task.sop"
        path.write_bytes(spoilt(chance, self.sop))
        if survives("check", path) == 0:
            survives("search-optimal", path, *QUICK)

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
        text = json.dumps(self.result)
        if chance.random() < 0.3:
            path.write_bytes(spoilt(chance, text.encode()))
        elif chance.random() < 0.2:
            number = chance.choice(list(NUMBER.finditer(text)))
            value = chance.choice(("1e999", "NaN", "-Infinity", "9" * 400, "-0"))
            path.write_text(text[: number.start()] + value + text[number.end() :], "utf-8")
        else:
            document = spoilt_document(chance, self.result, self.fuzz)
            path.write_text(json.dumps(document), "utf-8")
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

    def urdf_file(self, chance: random.Random) -> None:
        """Spoil bytes of a robot's description, and check a task with it."""
        (self.folder / "arm.urdf").write_bytes(spoilt(chance, self.urdf.encode()))
        survives("check", self.arm)

    def policies_file(self, chance: random.Random) -> None:
        """Spoil policies; what is not the same policy any more must not be called valid."""
        folder = self._fresh(self.folder / "policy")
        path = folder / "policies.json"
        if chance.random() < 0.3:
            path.write_bytes(spoilt(chance, self.policies))
        else:
            document = spoilt_document(chance, json.loads(self.policies), self.fuzz)
            path.write_text(json.dumps(document), "utf-8")
        code = survives("verify", folder, "--time-limit", "5", "--format", "json")
        survives("evaluate", self.folder / "chance.yaml", "--policy", path, *QUICK)
        if code == 0:
            # Only choices in states that the policy never reaches may differ.
            before, after = (json.loads(item) for item in (self.policies, path.read_bytes()))
            for document in (before, after):
                document["policies"][0].pop("choices")
            assert before == after, "a spoilt policy is valid"

    def manifest(self, chance: random.Random) -> None:
        """Spoil the manifest of a training, and evaluate and resume it."""
        folder = self._fresh(self.folder / "run")
        path = folder / "manifest.json"
        if chance.random() < 0.3:
            path.write_bytes(spoilt(chance, path.read_bytes()))
        else:
            document = spoilt_document(chance, json.loads(path.read_text("utf-8")), self.fuzz)
            path.write_text(json.dumps(document), "utf-8")
        survives("evaluate", folder, "--episodes", "2", "--format", "json")
        survives("report", folder, "--time-limit", "1", "--out", self._page())

    def journal(self, chance: random.Random) -> None:
        """Spoil the journal of a study, and go on with it."""
        folder = self._fresh(self.folder / "study")
        path = folder / "trials.jsonl"
        path.write_bytes(spoilt(chance, path.read_bytes()))
        survives(*STUDY, self.starter, "--trials", "3", "--out", folder)

    def verdict(self, chance: random.Random) -> None:
        """Spoil kept verdicts; the search comes to what it came to without them."""
        shutil.rmtree(self.folder / "cache", ignore_errors=True)
        shutil.copytree(self.folder / "kept", self.folder / "cache")
        kept = [path for path in sorted((self.folder / "cache").rglob("*")) if path.is_file()]
        for path in chance.sample(kept, min(3, len(kept))):
            content = path.read_bytes()
            swapped = content.replace(FEASIBLE, INFEASIBLE, 1)
            changed = swapped if chance.random() < 0.3 else spoilt(chance, content)
            path.write_bytes(changed)
        out = self.folder / "again"
        shutil.rmtree(out, ignore_errors=True)
        with self._cache("cache"):
            assert 0 == self._by_engine(out)
        document = json.loads((out / "result.json").read_text("utf-8"))
        plan = (document["status"], document["cost"], document["skills"])
        assert plan == self.engine_plan, "a spoilt verdict changed the result"

    def step(self, chance: random.Random) -> None:
        """Spoil bytes of a STEP file, and import it."""
        source = PARTS / "interlocked.step.gz"
        path = self.folder / "product.step"
        path.write_bytes(spoilt(chance, gzip.decompress(source.read_bytes())))
        self._import(path)

    def stl(self, chance: random.Random) -> None:
        """Spoil one of two meshes of a product, and import it."""
        folder = self.folder / "product"
        folder.mkdir(exist_ok=True)
        for number in range(2):
            path = folder / f"part_{number}.stl"
            path.write_bytes(box_stl(20.0 * number))
        path.write_bytes(spoilt(chance, path.read_bytes()))
        self._import(folder, "--unit", "mm")

    def _import(self, source: Path, *words: str) -> None:
        out = self.folder / "imported"
        shutil.rmtree(out, ignore_errors=True)
        limits = ("--time-limit", "5", "--no-cache", "--format", "json")
        if survives("import-cad", source, *words, *limits, "--out", out) == 0:
            written = json.loads((out / "report.json").read_text("utf-8"))
            assert (
                not (out / "product.yaml").exists() or survives("check", out / "product.yaml") == 0
            )
            assert written["schema"].startswith("skillplan.import/")

    def _fresh(self, folder: Path) -> Path:
        """Return a copy of a folder, to be spoilt."""
        copy = self.folder / f"spoilt-{folder.name}"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder, copy)
        return copy

    def _page(self) -> Path:
        page = self.folder / "page.html"
        page.unlink(missing_ok=True)
        return page


def mutate(tally: Tally, scale: float, kinds: Collection[str] = ()) -> None:
    """Do the cases of these kinds, or of all, as many as `CASES` says at scale 1."""
    with guarded_folder() as inside:
        inputs = Inputs(inside, whole=not kinds or not CHEAP.issuperset(kinds))
        for kind, way in inputs.ways().items():
            if kinds and kind not in kinds:
                continue
            each = max(1, round(CASES.get(kind, MOST_CASES) * scale))
            progress(f"{kind}: {each} inputs")
            for number in range(each):
                tally.case(kind, number, way)
