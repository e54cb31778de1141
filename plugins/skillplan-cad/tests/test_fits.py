"""Overlaps that are drawn on purpose, and those that are not."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from skillplan.cli import run
from skillplan_cad import (
    FitOptions,
    ReadOptions,
    compute_allowance_m,
    find_blocked,
    find_joints,
    read_product,
    relieve_fits,
)

TOLERANCE_M = 1e-4


def write(folder, pin_mm=10.1, **more):
    """Write a pin in a hub with a hole of 10 mm, and return the folder."""
    hub = trimesh.creation.annulus(r_min=5, r_max=20, height=20, sections=128)
    pin = trimesh.creation.cylinder(radius=pin_mm / 2, height=35, sections=128)
    pin.apply_translation((0, 0, 7.5))
    for name, mesh in {"hub": hub, "pin": pin, **more}.items():
        mesh.export(folder / f"{name}.stl")
    return folder


def contact(folder, first="hub", second="pin", **options):
    """Return the contact of two parts."""
    product = read_product(folder, ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "cylinders", "unscrew", FitOptions(**options))
    return next(item for item in joints.contacts if item.parts == (first, second))


def test_a_press_fit_has_a_depth_and_a_volume_whatever_the_facets(tmp_path):
    """0.05 mm a side over 20 mm; ISO 286 allows 0.053 mm at 10 mm."""
    fit = contact(write(tmp_path)).fit
    assert fit.kind == "press fit"
    assert fit.depth_m == pytest.approx(5e-5, rel=1e-3)
    assert fit.volume_m3 == pytest.approx(np.pi * (5.05**2 - 25) * 20e-9, rel=1e-3)
    assert fit.allowed_m == pytest.approx(5.3e-5)


def test_a_deeper_overlap_is_interference_until_it_is_declared_or_allowed(tmp_path):
    folder = write(tmp_path, pin_mm=10.6)
    assert contact(folder).interferes
    assert contact(folder).fit is None
    assert not contact(folder, allowance_m=4e-4).interferes
    declared = contact(folder, press_fits=(("pin", "hub"),))
    assert declared.fit.kind == "press fit"
    assert not declared.interferes


def test_a_fit_blocks_nothing_along_its_axis(tmp_path):
    """0.3 mm a side would block by rays, which let 0.1 mm pass."""
    product = read_product(write(tmp_path, pin_mm=10.6), ReadOptions("mm"))
    options = FitOptions(press_fits=(("pin", "hub"),))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew", options)

    def blocked(parts):
        entries = find_blocked(parts, joints.directions, TOLERANCE_M).entries
        return {entry.direction for entry in entries if entry.part == "pin"}

    assert blocked(product) == {0, 1, 2, 3, 4, 5}
    assert blocked(relieve_fits(product, joints.contacts, TOLERANCE_M)) == {0, 1, 2, 3}


def test_a_seal_may_be_squeezed_by_a_third_of_its_section(tmp_path):
    """A ring of 2 mm that stands 0.2 mm into its groove."""
    seal = trimesh.creation.torus(major_radius=21.0, minor_radius=1.2)
    fit = contact(write(tmp_path, pin_mm=9.9, **{"o-ring": seal}), "hub", "o-ring").fit
    assert fit.kind == "seal"
    assert fit.allowed_m == pytest.approx(0.3 * 2.4e-3, rel=1e-3)


@given(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0))
def test_the_allowance_grows_with_the_diameter(first_m, second_m):
    low, high = sorted((first_m, second_m))
    assert 0 < compute_allowance_m(low) <= compute_allowance_m(high) <= 1.4e-3


def test_a_pair_that_does_not_exist_is_refused_with_the_nearest_name(capsys, tmp_path):
    (tmp_path / "parts").mkdir()
    source = str(write(tmp_path / "parts"))
    for pair, words in (("pin", "give two part names, as A,B"), ("pinn,hub", "Did you mean 'pin'")):
        words_given = ["import-cad", source, "--unit", "mm", "--out", str(tmp_path / "out")]
        assert run([*words_given, "--no-cache", "--press-fit", pair]) == 2
        assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow(reason="simulates; that a fit blocks nothing is tested in every run")
def test_the_written_task_has_a_plan_for_swept_and_an_engine(tmp_path):
    (tmp_path / "parts").mkdir()
    source, out = write(tmp_path / "parts"), tmp_path / "out"
    assert run(["import-cad", str(source), "--unit", "mm", "--out", str(out), "--no-cache"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert [(fit["parts"], fit["kind"]) for fit in report["fits"]] == [
        (["hub", "pin"], "press fit")
    ]
    assert report["interference"] == []
    assert "0.4 mm of play" in (out / "product.yaml").read_text()
    task = str(out / "product.yaml")
    assert run(["search-optimal", task, "--collision", "swept", "--physics", "mujoco"]) == 0
