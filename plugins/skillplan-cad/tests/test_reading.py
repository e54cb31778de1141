"""Reading STEP files and folders of meshes, and what is refused."""

from __future__ import annotations

import gzip
import os
import signal
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import skillplan_cad as cad
from cad_fixtures import box as solid_box
from cad_fixtures import part_of
from cad_products import file, product, truth
from skillplan.errors import OptionError
from skillplan_cad import prepare
from skillplan_cad.reading import step_file
from thinned import slow_case, thinned


def box(size=(10, 10, 10), at=(0, 0, 0)):
    """Return the mesh of a box, in millimetres."""
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def folder(path, **meshes):
    """Write meshes, and return the folder."""
    for name, mesh in meshes.items():
        mesh.export(path / f"{name}.stl")
    return path


class TestStep:
    @pytest.mark.parametrize(
        "name", thinned(["bracket", "nested", "mirrored", "threads"], "bracket", "nested")
    )
    def test_all_parts_are_read_and_identical_ones_found(self, name):
        """Each instance is a part."""
        whole = product(name)
        assert truth(name)["parts"] == len(whole)
        shapes = {}
        for part in whole.parts:
            shapes.setdefault(part.shape, []).append(part.name)
        repeated = sorted(sorted(shape) for shape in shapes.values() if len(shape) > 1)
        assert truth(name).get("identical", []) == repeated

    def test_names_are_paths_in_the_tree(self):
        """Below its root."""
        assert "carriage_2/stud/pin" in [part.name for part in product("nested").parts]

    @pytest.mark.slow(reason="reads a file more; names are paths in every run")
    def test_an_instance_without_a_name_is_called_after_its_design(self, tmp_path):
        """Exporters number such instances; what they are is told by their design."""
        path = tmp_path / "threads.step"
        content = gzip.decompress(file("threads").read_bytes())
        path.write_bytes(content.replace(b"'bolt'", b"'NAUO7'"))
        whole = cad.read_product(path, cad.ReadOptions())
        named = product("threads")
        bolt = named.index("bolt")
        assert whole.parts[bolt].name == whole.parts[bolt].design != "NAUO7"

    def test_mirror_images_are_told_apart_from_identical_parts(self):
        """Though volume, area and all distances are the same."""
        whole = product("mirrored")
        right, left = whole.parts[whole.index("right")], whole.parts[whole.index("left_1")]
        assert right.shape != left.shape
        assert left.shape == right.mirrors

    @pytest.mark.slow(reason="reads two files; file names of meshes in every run")
    @pytest.mark.parametrize(
        ("name", "encoding"), [("法兰2", "gbk"), ("Träger", "cp1252"), ("ボルト", "cp932")]
    )
    def test_names_in_the_code_page_of_a_machine_are_read(self, tmp_path, name, encoding):
        path = tmp_path / "threads.step"
        content = gzip.decompress(file("threads").read_bytes())
        path.write_bytes(content.replace(b"'bolt'", f"'{name}'".encode(encoding)))
        whole = cad.read_product(path, cad.ReadOptions())
        assert name in [part.name for part in whole]
        assert f"names are read as {encoding}, as the file is not in UTF-8" in whole.warnings

    @pytest.mark.slow(reason="reads two files more; units of meshes in every run")
    def test_inches_are_converted(self):
        """The same bracket, saved in inches."""
        inch, metric = product("inch"), product("bracket")
        assert inch.unit == "inch"
        for part, other in zip(inch.parts, metric.parts, strict=True):
            assert part.bounds_m == pytest.approx(other.bounds_m, abs=1e-6)
            assert part.volume_m3 == pytest.approx(other.volume_m3, rel=1e-5)
        for name, unit, scale in (("inch", "mm", 1 / 25.4), ("bracket", "inch", 25.4)):
            restated = cad.read_product(file(name), cad.ReadOptions(unit=unit))
            assert restated.unit == unit
            for part, other in zip(restated.parts, metric.parts, strict=True):
                assert part.volume_m3 == pytest.approx(other.volume_m3 * scale**3, rel=1e-3)

    def test_a_stated_unit_with_which_no_fastener_exists_is_doubted(self):
        """A nut of 15 mm, as inches 381 mm; a shaft of 381 mm is none to doubt."""
        nut, block = solid_box(0, 0, 0, 381, 381, 200), solid_box(400, 0, 0, 2400, 2000, 500)
        parts = (part_of("nut", nut), part_of("block", block))
        huge = cad.Product("p", parts, "inch", 1e-4)
        assert cad.describe_unit_doubt(huge).startswith(
            "the file states inch, with which nut is 381 mm"
        )
        assert "--unit inch keeps" in cad.describe_unit_doubt(huge)
        assert not cad.describe_unit_doubt(replace(huge, unit="mm"))
        assert not cad.describe_unit_doubt(replace(huge, parts=(part_of("shaft", nut), parts[1])))
        assert not cad.describe_unit_doubt(replace(huge, chord_m=0.0))

    def test_faces_have_their_surfaces(self):
        """A washer is two planes and two cylinders, one of them hollow."""
        whole = product("bracket")
        faces = whole.parts[whole.index("washer_1")].faces
        assert sorted(face.kind for face in faces) == ["cylinder", "cylinder", "plane", "plane"]
        radii = {face.hollow: face.radius_m for face in faces if face.kind == "cylinder"}
        assert pytest.approx(radii) == {False: 0.0045, True: 0.00225}
        assert sum(len(face.triangles) for face in faces) == len(
            whole.parts[whole.index("washer_1")].triangles
        )

    def test_masses_are_those_of_steel(self):
        """9 x 4.5 x 1 mm, 7850 kg/m3."""
        whole = product("bracket")
        exact = np.pi * (4.5**2 - 2.25**2) * 1e-9 * 7850
        assert whole.parts[whole.index("washer_1")].mass_kg == pytest.approx(exact, rel=0.02)

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            (b"", "is empty"),
            (b"PK\x03\x04rest", "is a ZIP archive"),
            (b"solid cube", "is not a STEP file"),
            (b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=", "is cut off"),
            (b"\x1f\x8brest of no stream", "is damaged"),
            (gzip.compress(b"ISO-10303-21;" * 99, mtime=0)[:-9], "is cut off"),
            slow_case(
                b"ISO-10303-21;\nnothing\nEND-ISO-10303-21;\n",
                "STEP",
                reason="starts OCCT; a file that lacks a piece in every run",
            ),
        ],
    )
    def test_what_is_no_step_file_is_refused_in_words(self, tmp_path, content, words):
        """Whatever its name says."""
        path = tmp_path / "product.step"
        path.write_bytes(content)
        with pytest.raises(OptionError, match=words) as caught:
            cad.read_product(path, cad.ReadOptions())
        assert str(path) in str(caught.value)

    def test_a_file_that_lacks_a_piece_is_refused(self, tmp_path):
        """Though it ends as it should: parts would silently be missing."""
        path = tmp_path / "product.step"
        content = file("floating").read_bytes()
        path.write_bytes(content[: len(content) // 2] + b";\nENDSEC;\nEND-ISO-10303-21;\n")
        with pytest.raises(OptionError, match="is damaged: it refers to"):
            cad.read_product(path, cad.ReadOptions())

    def test_an_open_part_is_a_surface_that_is_told_with_its_place(self):
        """The tray lacks a side; the others do not lose their product for it."""
        whole = cad.read_product(file("open_mesh"), cad.ReadOptions())
        tray = whole.parts[whole.index("tray")]
        assert [part.name for part in whole if part.closure == "surface"] == ["tray"]
        assert tray.volume_m3 == pytest.approx(
            np.prod(tray.bounds_m[1] - tray.bounds_m[0]), rel=0.01
        )
        (warning,) = whole.warnings
        assert warning.startswith("tray is not closed: a surface of ")
        assert "4 open edges, one at" in warning


class TestFolders:
    def test_a_folder_needs_a_unit(self, tmp_path):
        """Meshes state none."""
        path = folder(tmp_path, one=box(), two=box(at=(10, 0, 0)))
        with pytest.raises(OptionError, match="--unit mm"):
            cad.read_product(path, cad.ReadOptions())
        with pytest.raises(OptionError, match="Did you mean 'mm'"):
            cad.read_product(path, cad.ReadOptions(unit="mmm"))

    @pytest.mark.parametrize(("unit", "volume"), [("mm", 1e-6), ("inch", 1e-6 * 25.4**3)])
    def test_meshes_are_parts_named_after_their_files(self, tmp_path, unit, volume):
        """In the order of their names."""
        path = folder(tmp_path, two=box(at=(10, 0, 0)), one=box())
        whole = cad.read_product(path, cad.ReadOptions(unit=unit))
        assert [part.name for part in whole.parts] == ["one", "two"]
        assert whole.parts[0].volume_m3 == pytest.approx(volume)
        assert whole.parts[0].shape == whole.parts[1].shape

    def test_cylinders_are_found_in_meshes(self, tmp_path):
        """By their facets."""
        peg = trimesh.creation.cylinder(radius=3, height=20, sections=48)
        path = folder(tmp_path, peg=peg, plate=box((30, 30, 5), (0, 0, -20)))
        whole = cad.read_product(path, cad.ReadOptions(unit="mm"))
        (round_face,) = [face for face in whole.parts[0].faces if face.kind == "cylinder"]
        assert round_face.radius_m == pytest.approx(0.003, rel=1e-3)
        assert np.abs(round_face.axis) == pytest.approx([0, 0, 1], abs=1e-6)
        assert [item.kind for item in whole.parts[1].faces] == ["plane"] * 6

    def test_bodies_of_a_part_are_counted_and_split_when_asked(self, tmp_path):
        """One file with two cubes."""
        both = trimesh.util.concatenate([box(), box(at=(30, 0, 0))])
        path = folder(tmp_path, both=both, plate=box((90, 30, 5), (0, 0, -20)))
        whole = cad.read_product(path, cad.ReadOptions(unit="mm"))
        assert whole.parts[0].bodies == 2
        assert any("--split-bodies" in note for note in whole.notes)
        apart = cad.read_product(path, cad.ReadOptions(unit="mm", split_bodies=True))
        assert [part.name for part in apart.parts] == ["both.1", "both.2", "plate"]

    @pytest.mark.parametrize(
        ("meshes", "words"),
        [
            ({}, "holds no meshes"),
            ({"one": box()}, "nothing to assemble"),
            (
                {"one": trimesh.util.concatenate([box(), box(at=(30, 0, 0))])},
                "of 2 bodies. --split-bodies",
            ),
        ],
    )
    def test_what_cannot_be_assembled_is_refused(self, tmp_path, meshes, words):
        with pytest.raises(OptionError, match=words):
            cad.read_product(folder(tmp_path, **meshes), cad.ReadOptions(unit="mm"))

    def test_a_damaged_mesh_is_left_out_by_its_file(self, tmp_path):
        """And what it was read as; the others do not lose their product for it."""
        folder(tmp_path, one=box(), three=box(at=(10, 0, 0)))
        (tmp_path / "two.ply").write_text("nonsense")
        whole = cad.read_product(tmp_path, cad.ReadOptions(unit="mm"))
        assert [part.name for part in whole] == ["one", "three"]
        (warning,) = whole.warnings
        assert warning.startswith("two is left out: two.ply cannot be read as PLY")

    @pytest.mark.parametrize(
        ("files", "names"),
        [
            (["pump_base", "pump_lid", "pump_arm"], ["arm", "base", "lid"]),
            (["part_1", "part_2", "part_3"], ["part_1", "part_2", "part_3"]),
            (["beam", "bearing", "belt"], ["beam", "bearing", "belt"]),
        ],
    )
    def test_a_common_beginning_is_cut_at_a_word_but_no_number_is_left(
        self, tmp_path, files, names
    ):
        folder(tmp_path, **{name: box(at=(20 * n, 0, 0)) for n, name in enumerate(files)})
        whole = cad.read_product(tmp_path, cad.ReadOptions(unit="mm"))
        assert [part.name for part in whole] == names

    def test_file_names_of_other_encodings_are_read(self, tmp_path):
        """A file name of GBK: an archive packed in China, unpacked here."""
        folder(tmp_path, one=box())
        (tmp_path / "one.stl").rename(tmp_path / os.fsdecode("轴承座.stl".encode("gbk")))
        folder(tmp_path, two=box(at=(10, 0, 0)))
        whole = cad.read_product(tmp_path, cad.ReadOptions(unit="mm"))
        assert sorted(part.name for part in whole) == ["two", "轴承座"]


class TestScenes:
    """3MF and GLB hold several meshes."""

    def test_nodes_of_a_glb_are_parts_in_metres_with_their_names_and_groups(self, tmp_path):
        scene = trimesh.Scene()
        cube = box((0.01, 0.01, 0.01))
        scene.add_geometry(cube, node_name="base")
        scene.graph.update("head", matrix=np.diag((-1, 1, 1, 1)))
        move = trimesh.transformations.translation_matrix((0.02, 0, 0))
        scene.add_geometry(cube, node_name="cover", parent_node_name="head", transform=move)
        (tmp_path / "pump.glb").write_bytes(scene.export(file_type="glb"))
        whole = cad.read_product(tmp_path / "pump.glb", cad.ReadOptions())
        assert sorted(part.name for part in whole) == ["base", "head/cover"]
        assert [part.volume_m3 for part in whole] == pytest.approx([1e-6, 1e-6])
        cover = whole.parts[whole.index("head/cover")]
        assert cover.centre_m == pytest.approx((-0.02, 0, 0), abs=1e-9)
        assert whole.parts[0].shape == whole.parts[1].shape

    @pytest.mark.parametrize(("unit", "metres"), [("millimeter", 1e-3), ("inch", 0.0254)])
    def test_objects_of_a_3mf_are_parts_in_its_unit(self, tmp_path, unit, metres):
        """Those of models of their own, too, as programs for printers write them."""
        cube = box((1, 1, 1))
        rows = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in cube.vertices)
        faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in cube.faces)
        mesh = f"<mesh><vertices>{rows}</vertices><triangles>{faces}</triangles></mesh>"
        model = (
            '<model unit="{unit}" xmlns:p="production"><resources>{objects}</resources>'
            "<build>{items}</build></model>"
        )
        first = f'<object id="1" name="base">{mesh}</object>'
        group = '<object id="2" name="head"><components><component objectid="1" {path}/>'
        group = group.format(path='p:path="/3D/own.model"') + "</components></object>"
        items = '<item objectid="1"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 3 0 0"/>'
        with zipfile.ZipFile(tmp_path / "pump.3mf", "w") as archive:
            own = model.format(unit=unit, objects=first.replace("base", "cover"), items="")
            archive.writestr("3D/own.model", own)
            whole = model.format(unit=unit, objects=first + group, items=items)
            archive.writestr("3D/3dmodel.model", whole)
        product = cad.read_product(tmp_path / "pump.3mf", cad.ReadOptions())
        assert [part.name for part in product] == ["base", "head/cover"]
        assert product.parts[1].volume_m3 == pytest.approx(metres**3)
        assert product.parts[1].centre_m == pytest.approx((3 * metres, 0, 0), abs=1e-9)

    def test_a_unit_is_for_glb_only(self, tmp_path):
        (tmp_path / "pump.3mf").write_bytes(b"")
        with pytest.raises(OptionError, match="3MF states its unit itself"):
            cad.read_product(tmp_path / "pump.3mf", cad.ReadOptions(unit="mm"))
        scene = trimesh.Scene([box(), box(at=(20, 0, 0))])
        (tmp_path / "pump.glb").write_bytes(scene.export(file_type="glb"))
        whole = cad.read_product(tmp_path / "pump.glb", cad.ReadOptions(unit="mm"))
        assert whole.parts[0].volume_m3 == pytest.approx(1e-6)


class TestOcctApart:
    """In a process of its own."""

    def test_a_crash_is_one_message(self, tmp_path):
        """As a fault in its memory is."""
        path = tmp_path / "cursed.step"
        with pytest.raises(OptionError, match=r"cursed\.step: OCCT crashed on it \(signal 11\)"):
            cad.read_in_process(path, signal.raise_signal, signal.SIGSEGV, cad.Limits(60))

    @pytest.mark.parametrize(
        ("limits", "words"),
        [
            (cad.Limits(0), "still reading after 0 s"),
            slow_case(
                cad.Limits(60, 1),
                "took more than .* of memory",
                reason="starts OCCT; the other limit in every run",
            ),
        ],
    )
    def test_a_file_that_takes_too_much_is_given_up(self, tmp_path, limits, words):
        """Time or memory."""
        path = tmp_path / "long.step"
        path.write_bytes(gzip.decompress(file("threads").read_bytes()))
        with pytest.raises(OptionError, match=words):
            cad.read_in_process(path, prepare, (str(path), 5e-5, [], {}), limits)

    def test_a_shape_that_stops_it_is_left_out_and_the_others_are_read(self, monkeypatch):
        """Whether OCCT crashes on it, or takes too much; it starts again without it."""
        everything = product("bracket")

        def stop(path, prepare, content, limits, report):
            if 1 not in content[3]:
                raise step_file.ReadingStopped("OCCT crashed", 1, "crashes OCCT (signal 11)")
            return prepare(content)(None)

        monkeypatch.setattr(step_file, "read_in_process", stop)
        whole = cad.read_product(file("bracket"), cad.ReadOptions())
        (missing,) = {part.shape for part in everything} - {
            everything.parts[everything.index(part.name)].shape for part in whole
        }
        lost = [part.name for part in everything if part.shape == missing]
        assert len(whole) == len(everything) - len(lost)
        assert [words for words in whole.warnings if "crashes OCCT (signal 11)" in words] == [
            f"{name}: crashes OCCT (signal 11), and is left out" for name in lost
        ]


class TestMending:
    def test_unmerged_vertices_inside_out_are_mended(self):
        """As a file of loose triangles has them."""
        mesh = box()
        loose = mesh.triangles.reshape(-1, 3)
        triangles = np.arange(len(loose)).reshape(-1, 3)[:, ::-1]
        result = cad.mend(cad.RawPart("cube", (), loose, triangles))
        assert result.open_edges == 0
        assert len(result.part.vertices_m) == 8
        corners = result.part.vertices_m[result.part.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1)) > 0).all()

    def test_a_cavity_is_no_body(self):
        """A shell that looks inwards, inside another."""
        hollow = box((4, 4, 4))
        hollow.invert()
        both = trimesh.util.concatenate([box(), hollow])
        result = cad.mend(
            cad.RawPart("cube", (), np.asarray(both.vertices), np.asarray(both.faces))
        )
        assert result.open_edges == 0
        assert result.bodies.max() == 0

    def test_a_body_beside_one_that_is_inside_out_is_no_cavity(self):
        """Whichever of both has the larger volume."""
        for size in (4, 20):
            beside, turned = box((size, size, size), (30, 0, 0)), box()
            turned.invert()
            both = trimesh.util.concatenate([beside, turned])
            result = cad.mend(
                cad.RawPart("pair", (), np.asarray(both.vertices), np.asarray(both.faces))
            )
            whole = trimesh.Trimesh(result.part.vertices_m, result.part.triangles, process=False)
            assert result.bodies.max() == 1
            assert whole.volume == pytest.approx(1000 + size**3)


def test_shapes_are_found_whatever_their_place_and_tessellation():
    """Turned, moved, mirrored; a cube of one kind of triangles and of another."""
    generator = np.random.default_rng(3)
    mesh = trimesh.util.concatenate([box((10, 4, 2)), box((2, 3, 9), (4, 3.5, 5))])
    wedge = trimesh.convex.convex_hull(np.vstack([mesh.vertices, [[9.0, 7.0, 1.0]]]))
    parts = []
    for number in range(3):
        turn = trimesh.transformations.random_rotation_matrix(generator.random(3))[:3, :3]
        turn = turn * (1, 1, -1) if number == 2 else turn
        faces = np.asarray(wedge.faces)[:, ::-1] if number == 2 else np.asarray(wedge.faces)
        points = np.asarray(wedge.vertices) @ turn.T + generator.random(3)
        parts.append(cad.RawPart(str(number), (), points, faces))
    shapes, mirrors = cad.find_shapes(parts, 0.0)
    assert shapes.tolist() == [0, 0, 1]
    assert mirrors == {1: 0}
