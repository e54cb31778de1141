"""From a product to its relation: contacts, fasteners, directions, what blocks what."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skillplan_cad.blocking.all_pairs import BlockingTest, answers_of, in_order
from skillplan_cad.joints.contacts_of import contacts_of
from skillplan_cad.joints.cylinder_fits import cylinder_fits
from skillplan_cad.joints.directions import Source, directions_of
from skillplan_cad.joints.fasteners_of import fasteners_of
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import (
    Blocking,
    Contact,
    Fastener,
    PartKind,
    Relation,
    RelationPart,
    Sensitive,
)

Threads = Literal["unscrew", "solid", "ignore"]
_ALONG = 0.999


@dataclass(frozen=True, slots=True)
class Joints:
    """How the parts of a product meet.

    Parameters
    ----------
    contacts, fasteners
        As found.
    directions
        Along which parts are moved.
    """

    contacts: tuple[Contact, ...]
    fasteners: tuple[Fastener, ...]
    directions: tuple[Vector, ...]


@dataclass(frozen=True, slots=True)
class Blocked:
    """What blocks what, before threads are waived."""

    entries: tuple[Blocking, ...]
    sensitive: tuple[Sensitive, ...]


def joints_of(product: Product, tolerance_m: float, source: Source, threads: Threads) -> Joints:
    """Return contacts, fasteners and directions of a product."""
    test = BlockingTest(product, tolerance_m)
    fits = cylinder_fits(product)
    contacts = contacts_of(product, test, fits, tolerance_m)
    fasteners = fasteners_of(product, fits, contacts, tolerance_m)
    directions = directions_of(source, fits, fasteners, contacts)
    named = _with_threads(contacts, fasteners, threads, tolerance_m)
    return Joints(named, fasteners, directions)


def blocked_of(
    product: Product,
    directions: Sequence[Vector],
    tolerance_m: float,
    on_done: Callable[[int, int], None] = lambda done, of: None,
    jobs: int = 1,
) -> Blocked:
    """Return what blocks what along directions, each of which is next to its opposite.

    Parameters
    ----------
    product
        The product.
    directions
        Unit vectors.
    tolerance_m
        Radius of the disc that has to be blocked.
    on_done
        Told how many of how many lines of directions are done.
    jobs
        How many processes may be used; nothing that is found depends on it.
    """
    lines = [(directions[one], one, one + 1) for one in range(0, len(directions), 2)]
    answers = []
    for answer in answers_of(product, tolerance_m, lines, jobs):
        answers.append(answer)
        on_done(len(answers), len(lines))
    entries, sensitive = in_order(product, answers)
    return Blocked(tuple(entries), tuple(sensitive))


def relation_of(
    product: Product, joints: Joints, blocked: Blocked, tolerance_m: float, threads: Threads
) -> Relation:
    """Return the relation: threads waived as wanted, parts by what they are for."""
    free = _waived(joints, threads)
    kinds: dict[str, PartKind] = {one.part: one.kind for one in joints.fasteners}
    first: dict[int, str] = {}
    for part in product.parts:
        first.setdefault(part.shape, part.name)
    return Relation(
        parts=tuple(
            RelationPart(
                part.name,
                kinds.get(part.name, "part"),
                None if first[part.shape] == part.name else first[part.shape],
                None if part.mirrors is None else first[part.mirrors],
                round(part.mass_kg, 9),
            )
            for part in product.parts
        ),
        tolerance_m=tolerance_m,
        directions=joints.directions,
        blocked=tuple(
            one for one in blocked.entries if (one.part, one.by, one.direction) not in free
        ),
        contacts=joints.contacts,
        fasteners=joints.fasteners,
        sensitive=tuple(
            one for one in blocked.sensitive if (one.part, one.by, one.direction) not in free
        ),
    )


def waived_pairs(joints: Joints, blocked: Blocked, threads: Threads) -> list[tuple[str, str, int]]:
    """Return the blockings that are left out because a thread is turned out of its mate."""
    free = _waived(joints, threads)
    return [
        (one.part, one.by, one.direction)
        for one in blocked.entries
        if (one.part, one.by, one.direction) in free
    ]


def _waived(joints: Joints, threads: Threads) -> set[tuple[str, str, int]]:
    found: set[tuple[str, str, int]] = set()
    if threads == "solid":
        return found
    for one in joints.fasteners:
        for mate in one.threaded_in:
            for number, direction in enumerate(joints.directions):
                along = float(np.dot(direction, one.axis))
                if threads == "ignore" or along > _ALONG:
                    found.add((one.part, mate, number))
                if threads == "ignore" or along < -_ALONG:
                    found.add((mate, one.part, number))
    return found


def _with_threads(
    contacts: Sequence[Contact],
    fasteners: Sequence[Fastener],
    threads: Threads,
    tolerance_m: float,
) -> tuple[Contact, ...]:
    """Return contacts with those of threads named, and with what fasteners may overlap."""
    if threads == "solid":
        return tuple(contacts)
    gripped = {frozenset((one.part, mate)): one for one in fasteners for mate in one.threaded_in}
    guided = {frozenset((one.part, other)) for one in fasteners for other in one.joins}
    found = []
    for contact in contacts:
        pair = frozenset(contact.parts)
        if pair in gripped:
            screw = gripped[pair]
            contact = replace(
                contact,
                kind="thread",
                axis=screw.axis,
                axis_point_m=contact.axis_point_m or screw.point_m,
                radius_m=contact.radius_m or screw.diameter_m / 2,
            )
        elif pair in guided:
            # CAD draws a hole as wide as its screw; what overlaps is within the tolerance.
            allowed = max(contact.overlap_allowed_m3, contact.overlap_surface_m2 / 2 * tolerance_m)
            contact = replace(contact, overlap_allowed_m3=allowed)
        found.append(contact)
    return tuple(found)
