"""Build the relation of a product: contacts, fasteners, directions, blockings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skillplan_cad.blocking.all_pairs import BlockingTest, compute_answers, merge_answers
from skillplan_cad.joints.contacts_of import find_contacts
from skillplan_cad.joints.cylinder_fits import find_cylinder_fits
from skillplan_cad.joints.directions import Source, choose_directions
from skillplan_cad.joints.fasteners_of import FastenerOptions, find_fasteners
from skillplan_cad.joints.fits import FitOptions, classify_overlaps, relieve_fits
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
    """Contacts and fasteners of a product, and the directions of motion.

    Parameters
    ----------
    notes
        Parts that are named like fasteners and are none, one sentence each.
    """

    contacts: tuple[Contact, ...]
    fasteners: tuple[Fastener, ...]
    directions: tuple[Vector, ...]
    notes: tuple[str, ...] = ()

    def relieve(self, product: Product, tolerance_m: float, play_m: float = 0.0) -> Product:
        """Return a product whose fits touch instead of overlapping, or have some play [m]."""
        return relieve_fits(
            product, self.contacts, self.fasteners, tolerance_m, play_m, self.directions
        )


@dataclass(frozen=True, slots=True)
class Blocked:
    """Blockings before threads are waived."""

    entries: tuple[Blocking, ...]
    sensitive: tuple[Sensitive, ...]


def find_joints(
    product: Product,
    tolerance_m: float,
    source: Source,
    threads: Threads,
    options: FitOptions | None = None,
    declared: FastenerOptions | None = None,
) -> Joints:
    """Return contacts, fasteners and directions of a product."""
    test = BlockingTest(product, tolerance_m)
    fits = find_cylinder_fits(product)
    contacts = find_contacts(product, test, fits, tolerance_m)
    recognised = find_fasteners(product, test, contacts, tolerance_m, declared)
    fasteners = recognised.fasteners
    directions = choose_directions(source, fits, fasteners, contacts)
    named = _mark_threads(contacts, fasteners, threads, tolerance_m)
    contacts = classify_overlaps(
        product, named, fits, fasteners, options or FitOptions(), directions
    )
    return Joints(contacts, fasteners, directions, recognised.notes)


def find_blocked(
    product: Product,
    directions: Sequence[Vector],
    tolerance_m: float,
    on_done: Callable[[int, int], None] = lambda done, of: None,
    jobs: int = 1,
) -> Blocked:
    """Return the blockings along directions, each of which is next to its opposite.

    Parameters
    ----------
    tolerance_m
        Smallest radius of a disc that counts as blocked [m].
    on_done
        Called with the number of finished lines and of all lines.
    jobs
        Number of processes; results do not depend on it.
    """
    lines = [(directions[number], number, number + 1) for number in range(0, len(directions), 2)]
    answers = []
    for answer in compute_answers(product, tolerance_m, lines, jobs):
        answers.append(answer)
        on_done(len(answers), len(lines))
    entries, sensitive = merge_answers(product, answers)
    return Blocked(tuple(entries), tuple(sensitive))


def assemble_relation(
    product: Product, joints: Joints, blocked: Blocked, tolerance_m: float, threads: Threads
) -> Relation:
    """Return the relation, with threads waived and parts classified."""
    free = _find_waived(joints, threads)
    kinds: dict[str, PartKind] = {fastener.part: fastener.kind for fastener in joints.fasteners}
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
            entry
            for entry in blocked.entries
            if (entry.part, entry.by, entry.direction) not in free
        ),
        contacts=joints.contacts,
        fasteners=joints.fasteners,
        sensitive=tuple(
            answer
            for answer in blocked.sensitive
            if (answer.part, answer.by, answer.direction) not in free
        ),
    )


def list_waived_pairs(
    joints: Joints, blocked: Blocked, threads: Threads
) -> list[tuple[str, str, int]]:
    """Return the blockings that are dropped because a thread turns out of its mate."""
    free = _find_waived(joints, threads)
    return [
        (entry.part, entry.by, entry.direction)
        for entry in blocked.entries
        if (entry.part, entry.by, entry.direction) in free
    ]


def _find_waived(joints: Joints, threads: Threads) -> set[tuple[str, str, int]]:
    waived: set[tuple[str, str, int]] = set()
    if threads == "solid":
        return waived
    for fastener in joints.fasteners:
        for mate in fastener.threaded_in:
            for number, direction in enumerate(joints.directions):
                along = float(np.dot(direction, fastener.axis))
                if threads == "ignore" or along > _ALONG:
                    waived.add((fastener.part, mate, number))
                if threads == "ignore" or along < -_ALONG:
                    waived.add((mate, fastener.part, number))
    return waived


def _mark_threads(
    contacts: Sequence[Contact], fasteners: Sequence[Fastener], threads: Threads, tolerance_m: float
) -> tuple[Contact, ...]:
    """Return contacts with threads marked, and the allowed overlaps of fasteners."""
    if threads == "solid":
        return tuple(contacts)
    gripped = {
        frozenset((fastener.part, mate)): fastener
        for fastener in fasteners
        for mate in fastener.threaded_in
    }
    guided = {frozenset((guide.part, other)) for guide in fasteners for other in guide.joins}
    marked = []
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
            # CAD draws holes as wide as their screws; such overlaps are within the tolerance.
            allowed = max(contact.overlap_allowed_m3, contact.overlap_surface_m2 / 2 * tolerance_m)
            contact = replace(contact, overlap_allowed_m3=allowed)
        marked.append(contact)
    return tuple(marked)
