"""Contacts, overlaps, fasteners and directions of products whose truth is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cad_products import moved, product, relation, truth
from skillplan_cad import FitOptions, find_joints
from thinned import thinned

NAMES = (
    "bracket",
    "eight",
    "bayonet",
    "dovetail",
    "fastened",
    "floating",
    "interlocked",
    "l_slot",
    "nested",
    "threads",
    "mirrored",
)


@pytest.fixture(scope="module")
def joints():
    """Return the joints of a fixture, found once."""
    kept = {}

    def found(name):
        if name not in kept:
            kept[name] = find_joints(product(name), 1e-4, "axes", "unscrew")
        return kept[name]

    return found


@pytest.mark.parametrize("name", thinned(NAMES, "fastened", "mirrored"))
def test_fasteners_are_found_and_none_is_invented(joints, name):
    """With what they are, and the line along which they come out."""
    expected = truth(name).get("fasteners", {})
    results = {fastener.part: fastener for fastener in joints(name).fasteners}
    assert set(expected) == set(results)
    for part, about in expected.items():
        assert about["kind"] == results[part].kind
        assert abs(np.dot(about["axis"], results[part].axis)) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("name", thinned(["bracket", "eight", "fastened"], "bracket", "fastened"))
def test_screws_without_a_name_are_known_by_head_and_drive(name):
    """As are washers and nuts on them; a pin without a name is a cylinder in holes."""
    whole = product(name)
    plain = dataclasses.replace(
        whole,
        parts=tuple(
            dataclasses.replace(part, name=f"part {number}", design="")
            for number, part in enumerate(whole.parts)
        ),
    )
    results = {
        fastener.part: fastener.kind
        for fastener in find_joints(plain, 1e-4, "axes", "unscrew").fasteners
    }
    entries = {
        f"part {whole.index(part)}": about["kind"]
        for part, about in truth(name)["fasteners"].items()
        if about["kind"] != "pin"
    }
    assert entries == results


def test_a_screw_comes_out_towards_its_head_and_joins_what_it_passes(joints):
    """From the head on; its thread is in the last."""
    screw = next(fastener for fastener in joints("bracket").fasteners if fastener.part == "screw_1")
    assert screw.axis == pytest.approx((0, 0, 1), abs=1e-6)
    assert screw.joins == ("washer_1", "angle", "plate")
    assert screw.threaded_in == ("plate",)
    assert screw.diameter_m == pytest.approx(0.004)


def test_a_nut_comes_off_the_end_of_its_bolt_and_joins_what_it_lies_on(joints):
    """And the bolt is threaded in it, not in what only guides it."""
    results = {fastener.part: fastener for fastener in joints("fastened").fasteners}
    assert results["nut"].axis == pytest.approx((0, 0, -1), abs=1e-6)
    assert results["nut"].joins == ("bolt", "base")
    assert results["nut"].threaded_in == ("bolt",)
    assert results["bolt"].threaded_in == ("nut",)
    assert results["bolt"].joins == ("washer", "cover", "base", "nut")


def test_a_fit_has_its_radius_and_by_how_much_the_hole_is_wider(joints):
    """Pins in holes of their own size, and a bolt with 0.3 mm of room all round."""
    results = {frozenset(contact.parts): contact for contact in joints("fastened").contacts}
    for pin, radius_m in (("pin_1", 0.002), ("plug", 0.004)):
        fit = results[frozenset((pin, "base"))]
        assert fit.kind == "cylinder"
        assert fit.radius_m == pytest.approx(radius_m, abs=1e-6)
        assert fit.radius_difference_m == pytest.approx(0, abs=1e-6)
    assert results[frozenset(("bolt", "nut"))].radius_difference_m == pytest.approx(-5e-4, abs=1e-6)
    assert frozenset(("bolt", "base")) not in results


@pytest.mark.parametrize("name", thinned(["bracket", "eight", "fastened"], "bracket", "fastened"))
def test_contacts_have_their_kinds(joints, name):
    """Flat on flat, and a cylinder in a cylinder, which is a thread where a screw is gripped."""
    kinds = {frozenset(contact.parts): contact.kind for contact in joints(name).contacts}
    for pair in truth(name)["contacts"]["plane"]:
        assert kinds[frozenset(pair)] == "plane"
    for pair in truth(name)["contacts"]["cylinder"]:
        assert kinds[frozenset(pair)] == "thread"


def test_parts_that_overlap_are_named_with_the_volume():
    """Beyond what chords explain."""
    (expected,) = truth("interfering")["interference"]
    options = FitOptions(allowance_m=1e-4)
    contacts = find_joints(product("interfering"), 1e-4, "axes", "unscrew", options).contacts
    (results,) = [contact for contact in contacts if contact.interferes]
    assert set(expected["parts"]) == set(results.parts)
    assert results.overlap_m3 * 1e9 == pytest.approx(expected["overlap_mm3"], rel=0.02)


@pytest.mark.parametrize(
    "name", thinned(["bracket", "eight", "nested", "dovetail", "bayonet"], "eight", "dovetail")
)
def test_parts_that_fit_are_not_said_to_overlap(joints, name):
    """Though their tessellated cylinders cut into each other."""
    assert [contact.parts for contact in joints(name).contacts if contact.interferes] == []


def test_what_floats_touches_nothing(joints):
    """The balloon has no contact."""
    assert {"plate", "block"} == {
        name for contact in joints("floating").contacts for name in contact.parts
    }


class TestDirections:
    def test_those_of_the_file_come_first_and_are_all_there_are_in_its_frame(self):
        """Cylinders along z add nothing."""
        result = find_joints(product("threads"), 1e-4, "cylinders", "unscrew").directions
        assert len(result) == 6
        assert result[:2] == ((1, 0, 0), (-1, 0, 0))

    def test_axes_of_cylinders_are_added_with_a_frame_about_them(self):
        """In a turned product; of the file's axes y is square to its cylinders, too."""
        turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
        array = np.array(
            find_joints(moved(product("threads"), turn), 1e-4, "cylinders", "unscrew").directions
        )
        assert len(array) == 10
        assert np.abs(array[6:] @ turn[:, 2]).max() == pytest.approx(1, abs=1e-6)

    def test_flat_contacts_add_their_normals_and_what_slides_on_two_of_them(self):
        """A dovetail slides along y, which is an edge of its contacts; its flanks are oblique."""
        array = np.array(find_joints(product("dovetail"), 1e-4, "contacts", "unscrew").directions)
        assert len(array) > 6
        assert np.linalg.norm(array, axis=1) == pytest.approx(np.ones(len(array)))


def test_relations_name_identical_and_mirrored_parts():
    """By the first of them."""
    parts = {part.name: part for part in relation("mirrored").parts}
    assert parts["left_2"].identical_to == "left_1"
    assert parts["left_1"].identical_to is None
    assert parts["right"].mirror_of == "left_1"
