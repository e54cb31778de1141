"""`skillplan import-cad` as users call it."""

from __future__ import annotations

import json
import re
from functools import partial

import jsonschema
import pytest
import yaml
from PIL import Image as PillowImage

import skillplan_cad as cad
from cad_products import FIXTURES, file, read_here
from skillplan.cli import run
from skillplan.errors import OptionError
from skillplan.plugins import installed
from skillplan.views.report import draw_import
from skillplan.views.tables import tabulate_import
from skillplan_cad.importing import import_cad
from thinned import slow_case

DOCUMENTS = FIXTURES.parents[3] / "docs/reference/documents"
SOURCE = str(file("threads"))


@pytest.fixture(autouse=True)
def registered(monkeypatch, tmp_path):
    """Let the command find the plugin, wherever it is installed, and keep nothing elsewhere."""

    class Entry:
        name, value, dist = "cad", "skillplan_cad.importing.import_cad:import_cad", None
        load = partial(getattr, import_cad, "import_cad")

    monkeypatch.setattr(installed, "importers", lambda: [Entry()])
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))
    read_here(monkeypatch)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return what an import wrote, once for all that only look at it."""
    folder = tmp_path_factory.mktemp("imported") / "product"
    given = {"keep": False, "nests": True}
    with pytest.MonkeyPatch.context() as patch:
        read_here(patch)
        import_cad.import_cad(SOURCE, str(folder), given, lambda line: None, draw_import)
    return folder


@pytest.mark.parametrize("name", ["relation", "import"])
def test_documents_fit_their_schemas(made, name):
    """As the reference publishes them."""
    schema = yaml.safe_load((DOCUMENTS / f"{name}.yaml").read_text("utf-8"))
    written = {"relation": "relation.json", "import": "report.json"}[name]
    jsonschema.validate(json.loads((made / written).read_text("utf-8")), schema)


def test_a_relation_that_was_written_is_read(made):
    """With the fastener, its thread waived."""
    relation = cad.read_relation(made / "relation.json")
    assert relation.names == ("block", "cap", "bolt")
    assert relation.fastener("bolt").threaded_in == ("block",)
    assert relation.blockers("bolt", 4) == ()


def test_a_picture_shows_the_parts_taken_apart(made):
    """Large enough to be read."""
    with PillowImage.open(made / "exploded.png") as picture:
        assert picture.format == "PNG"
        assert picture.width > 1000
        assert len(picture.convert("RGB").getcolors(maxcolors=1 << 24)) > 10


def test_a_page_shows_the_product_and_what_was_found(made):
    """It loads nothing, and a click on a part leads to its move."""
    page = (made / "import.html").read_text("utf-8")
    assert "All 3 parts of the product are in the task." in page
    for heading in ("Exploded", "In the task, and left out", "What blocks what", "Fasteners"):
        assert f">{heading}</h2>" in page
    assert '<span data-seek-s="0.000" tabindex="0" role="button">block</span>' in page
    assert "default-src &#x27;none&#x27;" in page
    assert not re.search(r'(src|href)="(?!#|data:)', page)


def test_parts_in_place_from_the_start_have_a_row_of_their_own(made):
    """As the arm does not bring them."""
    document = json.loads((made / "report.json").read_text("utf-8"))
    assert document["in_place"] == []
    *_, reasons = tabulate_import(document | {"in_place": ["block"]}, (), (), whole=True)
    assert reasons.title.endswith("3 of 3 parts in the task, 1 of them in place from the start")
    assert reasons.rows[1][1:] == ("1", "-", "block")


def test_nests_for_the_plan_are_written_and_drawn_on_the_page(made):
    """One, as the product is not turned."""
    (nest,) = json.loads((made / "report.json").read_text("utf-8"))["nests"]
    assert nest["check"]["good"]
    assert nest["parts"] == ["block"]
    names = {"nest_1.stl", "nest_1.obj", "nest_1.pieces.obj", "nest_1.png"}
    assert {path.name for path in (made / "nests").iterdir()} == names
    page = (made / "import.html").read_text("utf-8")
    assert ">Nests</h2>" in page
    assert "nest_1 for block, from above and in section." in page


@pytest.mark.slow(reason="imports twice; a relation that was written is read in every run")
def test_the_same_file_makes_the_same_bytes_and_stages_are_run_once(tmp_path, made, capsys):
    """Kept or made, by any number of processes; a change reruns what follows.

    What is kept and damaged is never trusted, but made anew.
    """
    messages = []
    for number, more in enumerate((["--threads", "solid"], ["--nests"], ["--robot", "ur5e"])):
        assert run(["import-cad", SOURCE, "--out", str(tmp_path / str(number)), *more]) == 0
        messages.append(capsys.readouterr().err)
    for path in (tmp_path / "cache" / "import-cad").iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    words = ["--out", str(tmp_path / "3"), "--nests", "--jobs", "2"]
    assert run(["import-cad", SOURCE, *words]) == 0
    assert "kept from" not in capsys.readouterr().err
    first, *others = (contents(folder) for folder in (made, tmp_path / "1", tmp_path / "3"))
    assert {"relation.json", "report.json", "exploded.png", "product.yaml"} < first.keys()
    assert "import.html" in first
    assert all(other == first for other in others)
    assert "kept from" not in messages[0]
    assert "joints ..." in messages[1]
    assert "blocking: kept from an earlier run" in messages[1]
    assert "planning ..." in messages[1]
    assert messages[2].count("kept from an earlier run") == 6


def contents(folder):
    """Return the bytes of all files in a folder."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([str(FIXTURES / "nothing.step")], "there is no such file or folder"),
        ([str(FIXTURES / "bracket.json")], "is neither STEP"),
        slow_case(
            [SOURCE, "--base", "blok"],
            "Did you mean 'block'",
            reason="imports first; a robot of no such name in every run",
        ),
        ([SOURCE, "--robot", "pandas"], "xarm7. Did you mean 'panda'"),
        ([SOURCE, "--tolerance", "20"], "must be from 0.001 to 10 mm"),
        ([SOURCE, "--tolerance", "nan"], "finite number"),
        ([SOURCE, "--directions", "all"], "is not one of 'axes'"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_is_written(tmp_path, capsys, words, message):
    """One message, exit code 2."""
    assert run(["import-cad", *words, "--out", str(tmp_path / "product")]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "product").exists()


def test_a_damaged_file_of_several_meshes_is_refused(tmp_path, capsys):
    for name in ("cube.glb", "cube.3MF"):
        (tmp_path / name).write_bytes(b"glTF")
        assert run(["import-cad", str(tmp_path / name), "--out", str(tmp_path / "product")]) == 2
        message = " ".join(capsys.readouterr().err.split())
        assert f"{name}: It cannot be read as {name[-3:].upper()}; save it again." in message


def test_a_folder_with_anything_in_it_is_left_alone(made, capsys):
    """Name a new one."""
    assert run(["import-cad", SOURCE, "--out", str(made)]) == 2
    assert "is not empty" in capsys.readouterr().err


@pytest.mark.slow(reason="imports two products more; overlaps are measured in every run")
def test_what_overlaps_is_stuck_or_floats_is_told_and_the_task_is_without_it(tmp_path, capsys):
    """On stderr, with names, places and options that may help; and in the report."""
    source, out = str(file("interfering")), tmp_path / "product"
    given = ["--fit-allowance", "0.1", "--format", "json"]
    assert run(["import-cad", source, "--out", str(out), *given]) == 0
    printed = capsys.readouterr()
    assert "block and pin overlap by 38." in printed.err
    message = " ".join(printed.err.split())
    assert "pin is stuck among block: no straight move, path or turn" in message
    assert "try --leave-out pin, or --press-fit pin,block if it is pressed in" in message
    document = json.loads(printed.out)
    assert [item["parts"] for item in document["interference"]] == [["block", "pin"]]
    assert document["left_out_why"] == {"pin": {"kind": "stuck", "by": ["block"]}}
    assert document == json.loads((out / "report.json").read_text("utf-8"))
    assert list(yaml.safe_load((out / "product.yaml").read_text("utf-8"))["parts"]) == ["block"]
    assert json.loads((out / "relation.json").read_text("utf-8"))["stuck"] == ["pin"]
    run(["import-cad", str(file("floating")), "--out", str(tmp_path / "other")])
    message = capsys.readouterr().err
    assert "balloon: touches no other part; the nearest is " in message
    document = json.loads((tmp_path / "other" / "report.json").read_text("utf-8"))
    assert list(document["left_out"]) == ["balloon"]
    assert document["left_out_why"] == {"balloon": {"kind": "floats", "by": []}}
    assert document["gaps"] == [{"part": "balloon", "nearest": "block", "gap_mm": 11.1803}]
    assert document["summary"]["left_out"] == [
        {
            "kind": "floats",
            "why": "touches no other part",
            "parts": ["balloon"],
            "by": [{"part": "block", "count": 1}],
        }
    ]
    assert document["attitude"]["stands"] == [
        {"part": "plate", "on": []},
        {"part": "block", "on": ["plate"]},
    ]


def test_a_plan_is_told_and_written_as_a_task(made):
    """With its base, the replay by other means, and the names that the task has."""
    document = json.loads((made / "report.json").read_text("utf-8"))
    plan = document["plan"]
    assert (plan["base"], plan["complete"], plan["replay"]["agrees"]) == ("block", True, True)
    assert [step["parts"] for step in plan["steps"]] == [["cap"], ["bolt"]]
    task = yaml.safe_load((made / "product.yaml").read_text("utf-8"))
    assert list(task["parts"]) == ["block", "cap"]
    assert task["screws"]["bolt"]["through"] == "cap"
    assert (made / "meshes" / "cap.obj").exists()


def test_without_the_plugin_the_command_says_how_to_get_it(monkeypatch, capsys, tmp_path):
    """It is listed in any case, and needs nothing until it is called."""
    monkeypatch.setattr(installed, "importers", list)
    assert run(["import-cad", SOURCE, "--out", str(tmp_path / "product")]) == 2
    assert "skillplan[cad]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cap", "give a pattern and a material, as 'lid*=abs'"),
        ("cap=aluminum", "is not one of steel,"),
        ("cap=aluminum", "Did you mean 'aluminium'?"),
        ("cap=inf", "a density must be from 1 to 30000 kg/m3"),
        ("cap=0.5", "a density must be from 1 to 30000 kg/m3"),
    ],
)
def test_a_wrong_material_is_refused_with_what_there_is(text, message):
    with pytest.raises(OptionError, match=re.escape(message)):
        cad.parse_material(text)


def test_the_last_material_that_fits_a_part_counts_and_the_default_is_told_once():
    product = cad.read_product(file("threads"), cad.ReadOptions())
    known, materials = cad.assign_materials(product, ["c*=abs", "cap=1850", "bolt=stainless"], 2700)
    assert materials == {"cap": "1850", "bolt": "stainless"}
    assert [part.density_kg_m3 for part in known] == [2700, 1850, 7900]
    assert known.notes[-1].startswith("masses assume 2700 kg/m3 for 1 of 3 parts")
    with pytest.raises(OptionError, match=r"no part has such a name\. Did you mean 'cap'\?"):
        cad.assign_materials(product, ["cab=abs"], 7850)
