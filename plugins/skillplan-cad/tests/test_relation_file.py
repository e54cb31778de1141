"""`relation.json` holds a relation whole."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import skillplan_cad as cad
from skillplan.errors import OptionError

X, MINUS_X, Y, MINUS_Y = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
Z, MINUS_Z = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def a_relation() -> cad.Relation:
    """A screw in a plate, as found at 0.1 mm."""
    return cad.Relation(
        parts=(
            cad.RelationPart("plate", "part", None, None, 0.25),
            cad.RelationPart("screw", "screw", None, None, 0.005),
        ),
        tolerance_m=0.0001,
        directions=(X, MINUS_X, Y, MINUS_Y, Z, MINUS_Z),
        blocked=(
            cad.Blocking("plate", "screw", 0, 0.0, 0.004, (0.01, 0.0, 0.0)),
            cad.Blocking("screw", "plate", 1, 0.0, 0.004, (0.01, 0.0, 0.0), sensitive=True),
        ),
        contacts=(
            cad.Contact(
                ("plate", "screw"), "thread", 0.0001, (Z,), Z, (0.01, 0.0, 0.0), 0.002, -0.0001,
                ((0.01, 0.002, 0.0),), 2e-9, 1e-9, (0.01, 0.0, 0.001), 3e-6,
            ),
        ),
        fasteners=(
            cad.Fastener(
                "screw", "screw", Z, (0.01, 0.0, 0.02), 0.004, 0.01, ("plate",), ("plate",),
                ("name", "head"),
            ),
        ),
        sensitive=(cad.Sensitive("screw", "plate", 1, True, 0.0002),),
        groups=(("plate", "screw"),),
        stuck=("screw",),
    )  # fmt: skip


def test_a_relation_is_read_as_it_was_written(tmp_path):
    """Nothing is lost, and the same relation makes the same bytes."""
    path = tmp_path / "relation.json"
    path.write_text(cad.format_relation(a_relation()), "utf-8")
    read = cad.read_relation(path)
    assert a_relation() == read
    assert cad.format_relation(read) == path.read_text("utf-8")


def test_blockers_are_looked_up_by_part_and_direction():
    """As in "the screw, moved along -x, is blocked by the plate"."""
    relation = a_relation()
    assert relation.blockers("screw", 1) == ("plate",)
    assert relation.blockers("screw", 4) == ()
    assert np.count_nonzero(relation.matrix) == 2
    assert relation.fastener("screw").part == "screw"
    assert relation.fastener("plate") is None


def test_two_parts_of_one_name_are_no_relation():
    """Names are what entries refer to."""
    relation = a_relation()
    with pytest.raises(ValueError, match="one name"):
        dataclasses.replace(relation, parts=(relation.parts[0], relation.parts[0]))


@pytest.mark.parametrize(
    ("old", "new"), [('"plate"', "7"), ('"axis"', '"axle"'), ("relation/1", "relation/9")]
)
def test_a_damaged_file_is_refused_in_words(tmp_path, old, new):
    """With its path, and what to do."""
    path = tmp_path / "relation.json"
    path.write_text(cad.format_relation(a_relation()).replace(old, new, 2), "utf-8")
    with pytest.raises(OptionError, match=r"relation\.json"):
        cad.read_relation(path)
