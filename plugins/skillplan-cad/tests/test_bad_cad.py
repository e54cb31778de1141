"""Whatever is wrong with CAD: one message with the remedy, exit code 2, nothing written."""

from __future__ import annotations

import gzip
import random
from functools import partial

import pytest
import trimesh

from cad_products import file
from skillplan.cli.app import run
from skillplan.errors import OptionError
from skillplan.plugins import installed
from skillplan_cad.importing import import_cad
from skillplan_cad.reading.product_reader import ReadOptions, read_product

END = b"\nENDSEC;\nEND-ISO-10303-21;\n"
LARGE_BYTES = 200 * 1024 * 1024


@pytest.fixture(autouse=True)
def registered(monkeypatch, tmp_path):
    """Let the command find the plugin, wherever it is installed, and keep nothing elsewhere."""

    class Entry:
        name, value, dist = "cad", "skillplan_cad.importing.import_cad:import_cad", None
        load = partial(getattr, import_cad, "import_cad")

    monkeypatch.setattr(installed, "importers", lambda: [Entry()])
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))


def cube(x_mm: float = 0.0):
    """Return a cube of 10 mm."""
    mesh = trimesh.creation.box((10, 10, 10))
    mesh.apply_translation((x_mm, 0, 0))
    return mesh


def opened():
    """Return a cube that lacks a side."""
    mesh = cube()
    mesh.update_faces(list(range(10)))
    return mesh


def sparse(path):
    """Make a file of 200 MB that takes no room."""
    with path.open("wb") as stream:
        stream.write(b"ISO-10303-21;\n")
        stream.truncate(LARGE_BYTES)


def refused(capsys, tmp_path, *words):
    """Return what an import says that must refuse what it was given."""
    out = tmp_path / "product"
    assert run(["import-cad", *words, "--out", str(out)]) == 2
    assert not out.exists()
    said = capsys.readouterr().err
    assert said.count("error:") == 1
    assert "Traceback" not in said
    return " ".join(said.split())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty. Save it from CAD as STEP"),
        (b"PK\x03\x04rest", "is a ZIP archive, whatever its name says. Unpack it first"),
        (b"ISO-10303-21;\nDATA;\n#1=", "is cut off"),
        (
            b"ISO-10303-21;\nDATA;\n#1=A(#2);" + END,
            "is damaged: it refers to 1 entity that it lacks",
        ),
    ],
)
def test_a_damaged_step_file_is_refused_by_the_command(capsys, tmp_path, content, words):
    source = tmp_path / "whole.step"
    source.write_bytes(content)
    said = refused(capsys, tmp_path, str(source))
    assert f"{source.name}: {words}" in said


@pytest.mark.parametrize(
    ("meshes", "options", "words"),
    [
        ({"one": cube()}, ("--unit", "mm"), "holds one part, one; there is nothing to assemble"),
        (
            {"one": cube() + cube(30.0)},
            ("--unit", "mm"),
            "holds one part, one, of 2 bodies. --split-bodies makes each",
        ),
        ({"one": cube(), "two": cube(10.0)}, (), "meshes have no unit. State it: --unit mm"),
        (
            {"one": cube(), "two": cube(10.0)},
            ("--unit", "parsec"),
            "is no unit known here. Known: cm, foot, inch, m, mm, um",
        ),
        (
            {"one": opened(), "two": cube(10.0)},
            ("--unit", "mm"),
            "not watertight: one (4 open edges, one at [5, -5, 0] mm). Make solids of these",
        ),
        ({}, ("--unit", "mm"), "holds no meshes"),
    ],
)
def test_meshes_that_are_no_product_are_refused(capsys, tmp_path, meshes, options, words):
    source = tmp_path / "parts"
    source.mkdir()
    for name, mesh in meshes.items():
        mesh.export(source / f"{name}.stl")
    assert words in refused(capsys, tmp_path, str(source), *options)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("huge.step", "Save sub-assemblies one by one"), ("parts/huge.stl", "with fewer triangles")],
)
def test_a_file_of_200_megabytes_is_refused_with_the_limit(capsys, tmp_path, name, remedy):
    source = tmp_path / name
    source.parent.mkdir(exist_ok=True)
    sparse(source)
    options = () if source.suffix == ".step" else ("--unit", "mm")
    given = source if not options else source.parent
    said = refused(capsys, tmp_path, str(given), *options)
    assert "larger than the 134,217,728 bytes" in said
    assert remedy in said


def test_an_empty_mesh_is_refused_with_its_file_and_what_to_do(capsys, tmp_path):
    source = tmp_path / "parts"
    source.mkdir()
    (source / "one.stl").write_bytes(b"")
    said = refused(capsys, tmp_path, str(source), "--unit", "mm")
    assert "one.stl: is empty. Save it anew, or take it out of the folder" in said


def damaged(content: bytes, seed: int) -> bytes:
    """Return a file that is cut off, or cut off and ended well, or of which bits are flipped."""
    chance = random.Random(seed)
    if seed % 4 == 0:
        return content[: chance.randrange(len(content))]
    if seed % 4 == 1:
        return content[: chance.randrange(len(content))] + END
    changed = bytearray(content)
    for _ in range(1 if seed % 4 == 2 else 8):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


@pytest.mark.parametrize(
    "seed",
    [
        seed
        if seed in (0, 4)
        else pytest.param(
            seed,
            marks=pytest.mark.release(reason="starts OCCT for most seeds; two in every run"),
        )
        for seed in range(40)
    ],
)
@pytest.mark.parametrize("name", ["dovetail", "floating"])
def test_damage_is_refused_in_words_or_makes_no_difference(tmp_path, name, seed):
    """A flipped bit may lie where it matters to nobody; any other damage is one message."""
    content = file(name).read_bytes()
    content = gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content
    path = tmp_path / "damaged.step"
    path.write_bytes(damaged(content, seed))
    told, read = "", ()
    try:
        read = read_product(path, ReadOptions())
    except OptionError as error:
        told = str(error)
    assert len(read) > 1 or told.startswith(f"{path}: ")
