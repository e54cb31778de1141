"""The page of a product from CAD: parts, reasons, blockings, fasteners, fits, nests, playback."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skillplan.task.shape import Mesh
from skillplan.views.figures.exploded_figure import (
    AddedBody,
    Piece,
    draw_product,
    list_added_parts,
    render_exploded_png,
    take_apart,
)
from skillplan.views.figures.exploded_labels import MOST_NAMED
from skillplan.views.figures.nest_figure import draw_nest, list_nest_facts, render_nest_png
from skillplan.views.figures.picture import COLOURS, Picture
from skillplan.views.playback.document import Playback
from skillplan.views.playback.meshes import coarsen
from skillplan.views.playback.tracks import FRAMES_PER_S, Numbers
from skillplan.views.report.markup import Markup, facts, join, note, number, table, tag
from skillplan.views.report.page import Chapter, Section, load_player, render_page
from skillplan.views.report.plan_sections import build_playback_section, caption_picture
from skillplan.views.text.wording import IN_PLACE, count, name_direction, shorten_names

_Document = Mapping[str, Any]

# Times in which the product comes apart and in which a part comes, as far as the sum allows [s].
_APART_S, _PART_S, _MOST_S = 6.0, 1.5, 60.0
_LONGEST_LABEL = 34
# Largest number of triangles of a page; finer meshes are coarsened to this share of the product.
_MOST_TRIANGLES, _CELL_SHARE = 400_000, 1 / 400
# Half the field of view of the player.
_HALF_FIELD_RAD = math.radians(19)
# Distance of the eye as a share of that at which the sphere about the product fills the picture.
_CLOSE = 0.7
_TOWARDS_EYE = np.array([0.6, -0.8, 0.5])
_MOST_BLOCKERS = 12


def draw_import(
    document: _Document, relation: _Document, added: Sequence[AddedBody]
) -> dict[str, str | bytes]:
    """Return exploded view, page and drawings of nests as files; parameters as of the page."""
    drawings = {
        f"nests/{nest['name']}.png": render_nest_png(nest) for nest in document.get("nests", [])
    }
    picture = draw_product(document["product"], added)
    return {
        **drawings,
        "exploded.png": render_exploded_png(picture),
        "import.html": render_import_page(document, relation, added, picture),
    }


def render_import_page(
    document: _Document, relation: _Document, added: Sequence[AddedBody], picture: Picture
) -> str:
    """Return the page of an imported product.

    Parameters
    ----------
    document
        ``skillplan.import/1``.
    relation
        ``skillplan.relation/1``.
    added
        Bodies in the order of the plan, at least one.
    picture
        Exploded view of these bodies.
    """
    pieces = take_apart(list_added_parts(added))
    player = load_player()
    playback = _ProductPlayback(document["product"], pieces)
    sections = [
        _build_playback(picture, playback, playable=player is not None),
        _build_reasons(document),
        _build_parts(document, playback.starts_s),
        _build_blockings(document, relation),
        _build_fasteners(relation),
        _build_overlaps(document),
        *_build_nests(document),
        _build_remarks(document),
    ]
    tree = _build_tree([part["name"] for part in document["parts"]])
    if tree is not None:
        sections.insert(3, tree)
    title = f"{document['product']}, from CAD"
    chapter = Chapter("product", title, _build_lead(document, relation), sections)
    return render_page(title, [chapter], None if player is None else playback.document(), player)


def _build_lead(document: _Document, relation: _Document) -> Markup:
    """Return the coverage of the task in a sentence, with figures."""
    total, in_task = document["summary"]["parts"], len(document["summary"]["in_task"])
    kinds = [part["kind"] for part in document["parts"]]
    figures: list[tuple[str, object]] = [
        ("Parts", total),
        ("In the task", in_task),
        ("Left out", total - in_task),
        ("Fasteners", sum(kind != "part" for kind in kinds)),
        ("Contacts", len(relation["contacts"])),
        ("Overlaps left", len(document["interference"])),
        ("Stuck", len(relation["stuck"])),
    ]
    items = [tag("div", {}, tag("dt", {}, name), tag("dd", {}, value)) for name, value in figures]
    return join(
        [
            tag("p", {"class": "lead"}, describe_coverage(in_task, total)),
            tag("dl", {"class": "figures"}, *items),
        ]
    )


def describe_coverage(in_task: int, total: int) -> str:
    """Return the number of a product's parts that a task or plan covers, as a sentence."""
    if in_task == total:
        return f"All {total} parts of the product are in the task."
    if not in_task:
        return f"No task is written: none of the {total} parts of the product is left for it."
    return f"{in_task} of {total} parts of the product are in the task; {total - in_task} left out."


def _build_playback(picture: Picture, playback: _ProductPlayback, *, playable: bool) -> Section:
    still = caption_picture(picture, "exploded", "Exploded along the moves of the plan.")
    shown = playback.document() if playable else None
    section = build_playback_section(shown, still, "the player is not built")
    words = (
        "The slider puts the product together in the order of the plan; its end takes it apart at "
        "once. A click on a part in the table below jumps to its move."
    )
    inner = [section.content, note(words)] if playable else [still]
    return Section("exploded", "Exploded", join(inner))


class _ProductPlayback:
    """A product that is put together part by part, and comes apart at once.

    Attributes
    ----------
    starts_s
        Time at which each body comes, by name.
    """

    def __init__(self, name: str, pieces: Sequence[Piece]) -> None:
        length = max(2, round(min(_PART_S, _MOST_S / len(pieces)) * FRAMES_PER_S))
        whole = length * len(pieces)
        frames = whole + round(_APART_S * FRAMES_PER_S) + 1
        self._playback = Playback(name, frames, "along the plan, not simulated")
        self.starts_s: dict[str, float] = {}
        names = [piece.part.body.name for piece in pieces]
        labels = shorten_names(names, lambda label: len(label) <= _LONGEST_LABEL)
        if len(pieces) > MOST_NAMED:
            labels = [str(piece.number) for piece in pieces]
        points = np.concatenate([piece.corners for piece in pieces])
        size_m = float(np.ptp(points, axis=0).max())
        self._cell_m = size_m * _CELL_SHARE if _count_triangles(pieces) > _MOST_TRIANGLES else 0.0
        for index, (piece, label) in enumerate(zip(pieces, labels, strict=True)):
            begin = index * length
            rows = _make_track(piece, frames, begin, begin + length, whole)
            shapes = [
                self._coarse(shape)
                if self._cell_m and isinstance(shape, Mesh)
                else self._playback.solid(shape)
                for shape in piece.part.body.exact_shapes
            ]
            colour = COLOURS[piece.part.role]
            self._playback.add_body(label, "part", shapes, rows=rows, label=True, color=colour)
            words = f"{piece.part.body.name} along {name_direction(piece.part.along)}"
            self._add_skill(words, begin, begin + length, label)
            self.starts_s[piece.part.body.name] = begin / FRAMES_PER_S
        self._add_skill("all parts at once, outwards", whole, frames - 1, None)
        low, high = points.min(axis=0), points.max(axis=0)
        middle = (low + high) / 2
        away_m = _CLOSE * float(np.linalg.norm(high - low)) / 2 / math.sin(_HALF_FIELD_RAD)
        eye = middle + away_m * _TOWARDS_EYE / np.linalg.norm(_TOWARDS_EYE)
        self._playback.view = (middle.tolist(), eye.tolist())

    def _coarse(self, shape: Mesh) -> dict[str, Any]:
        corners, faces = np.array(shape.corners), np.array(shape.faces, dtype=np.int64)
        points, triangles = coarsen(corners, faces, self._cell_m)
        # A part smaller than a cell keeps its mesh.
        return self._playback.mesh(*((points, triangles) if len(triangles) else (corners, faces)))

    def _add_skill(self, name: str, begin: int, end: int, subject: str | None) -> None:
        times = {"start_s": begin / FRAMES_PER_S, "end_s": end / FRAMES_PER_S}
        about = {"arm": "", "tool": None, "subject": subject, "note": None}
        self._playback.skills.append({"name": name, **times, **about})

    def document(self) -> dict[str, Any]:
        """Return the document ``skillplan.playback/1``."""
        return self._playback.document()


def _count_triangles(pieces: Sequence[Piece]) -> int:
    shapes = (shape for piece in pieces for shape in piece.part.body.exact_shapes)
    return sum(len(shape.faces) for shape in shapes if isinstance(shape, Mesh))


def _make_track(piece: Piece, frames: int, begin: int, end: int, whole: int) -> Numbers:
    """Return the pose of a piece in every frame: away, at its goal, and away again."""
    at = [begin, end, whole, frames - 1]
    shares = np.interp(np.arange(frames), at, [1.0, 0.0, 0.0, 1.0])
    goal, away = (np.array(pose.position) for pose in (piece.part.goal, piece.pose))
    places = goal + shares[:, None] * (away - goal)
    return np.hstack([places, np.tile(np.array(piece.pose.orientation), (frames, 1))])


def _build_reasons(document: _Document) -> Section:
    summary = document["summary"]
    in_task = summary["in_task"]
    rows = [["in the task", len(in_task), "", ", ".join(in_task) or "-"]]
    if in_place := document.get("in_place"):
        rows.append([IN_PLACE, len(in_place), "", ", ".join(in_place)])
    for reason in summary["left_out"]:
        causes = ", ".join(
            f"{cause['part']} ({cause['count']})" if cause["count"] > 1 else cause["part"]
            for cause in reason["by"]
        )
        names = ", ".join(reason["parts"])
        rows.append([reason["why"], len(reason["parts"]), causes, names])
    columns = ["parts by reason", "count", "because of", "names"]
    inner = [table("Parts in the task, and the others by reason", columns, rows, " n")]
    left_out = document.get("left_out", {})
    if left_out:
        words = [[name, text] for name, text in left_out.items()]
        every = table("Reason for each part", ["part", "it ..."], words)
        inner.append(
            tag("details", {}, tag("summary", {}, f"All {len(words)} in full words"), every)
        )
    return Section("reasons", "In the task, and left out", join(inner))


def _build_parts(document: _Document, starts_s: Mapping[str, float]) -> Section:
    order = {name: number for number, name in enumerate(starts_s, 1)}
    why = {
        name: reason["kind"]
        for reason in document["summary"]["left_out"]
        for name in reason["parts"]
    }
    rows = [
        [
            _link_to_move(part["name"], starts_s),
            order.get(part["name"], "-"),
            part["kind"],
            number(part["mass_kg"], 4),
            " x ".join(f"{side:.4g}" for side in part["size_mm"]),
            part["closure"],
            ", ".join(map(name_direction, part["free"])) or "none",
            f"no: {why[part['name']]}" if part["name"] in why else "yes",
        ]
        for part in document["parts"]
    ]
    columns = ["part", "number", "kind", "mass [kg]", "size [mm]", "mesh", "free along"]
    columns += ["in the task"]
    caption = f"{count(len(rows), 'part')} in the order of the file, with the number in pictures"
    return Section("parts", "Parts", table(caption, columns, rows, " n nn"))


def _link_to_move(name: str, starts_s: Mapping[str, float]) -> object:
    """Return a name on which a click moves the player to the part's move."""
    if name not in starts_s:
        return name
    time = f"{starts_s[name]:.3f}"
    return tag("span", {"data-seek-s": time, "tabindex": "0", "role": "button"}, name)


def _build_tree(names: Sequence[str]) -> Section | None:
    """Return the tree of assemblies, or None if no part is in one."""
    if not any("/" in name for name in names):
        return None
    tree: dict[str, Any] = {}
    for name in names:
        node = tree
        for word in name.split("/"):
            node = node.setdefault(word, {})
    return Section("tree", "Tree", _list_branches(tree))


def _list_branches(tree: Mapping[str, Any]) -> Markup:
    items = [
        tag(
            "li",
            {},
            tag("details", {}, tag("summary", {}, name), _list_branches(inner)) if inner else name,
        )
        for name, inner in tree.items()
    ]
    return tag("ul", {}, *items)


def _build_blockings(document: _Document, relation: _Document) -> Section:
    """Return for each part the parts in its way by direction."""
    blocked: dict[tuple[str, tuple[float, ...]], list[Mapping[str, Any]]] = {}
    for entry in relation["blocked"]:
        blocked.setdefault((entry["part"], tuple(entry["direction"])), []).append(entry)
    stuck = set(relation["stuck"])
    inner = []
    for part in relation["parts"]:
        name = part["name"]
        rows = []
        for direction in relation["directions"]:
            entries = sorted(
                blocked.get((name, tuple(direction)), ()), key=lambda entry: entry["distance_mm"]
            )
            names = [entry["by"] for entry in entries]
            more = len(names) - _MOST_BLOCKERS
            end = f" and {more} more" if more > 0 else ""
            first = number(entries[0]["distance_mm"], 4) if entries else "-"
            shown = ", ".join(names[:_MOST_BLOCKERS]) or "nothing: free"
            rows.append([name_direction(direction), first, f"{shown}{end}"])
        free = sum(row[1] == "-" for row in rows)
        words = f"{name}: " + ("stuck" if name in stuck else f"free along {free} of {len(rows)}")
        columns = ["direction", "after [mm]", "blocked by, the nearest first"]
        inner.append(
            tag(
                "details",
                {},
                tag("summary", {}, words),
                table(f"What blocks {name}", columns, rows, " n", captioned=False),
            )
        )
    words = (
        f"With the whole product in place, at a tolerance of {document['tolerance_mm']:g} mm. "
        f"'skillplan explain relation.json free(PART)' prints one of them with places."
    )
    return Section("blockings", "What blocks what", join([note(words), *inner]))


def _build_fasteners(relation: _Document) -> Section:
    rows = [
        [
            fastener["part"],
            fastener["kind"],
            number(fastener["diameter_mm"], 4),
            number(fastener["length_mm"], 4),
            ", ".join(fastener["joins"]) or "-",
            ", ".join(fastener["threaded_in"]) or "-",
            ", ".join(fastener["by"]),
        ]
        for fastener in relation["fasteners"]
    ]
    columns = ["part", "kind", "diameter [mm]", "length [mm]", "joins", "threaded in", "known by"]
    content = (
        table(count(len(rows), "fastener"), columns, rows, "  nn")
        if rows
        else note("No part was recognised as a screw, nut, washer or pin.")
    )
    return Section("fasteners", "Fasteners", content)


def _build_overlaps(document: _Document) -> Section:
    """Return the fits, the overlaps that are none, and the gaps of parts that touch nothing."""
    fits = [
        [
            " and ".join(fit["parts"]),
            fit["kind"],
            number(fit["depth_mm"], 3),
            number(fit["allowed_mm"], 3),
            number(fit["volume_mm3"], 4),
        ]
        for fit in document["fits"]
    ]
    overlaps = [
        [
            " and ".join(overlap["parts"]),
            number(overlap["overlap_mm3"], 4),
            number(overlap["depth_mm"], 3),
            ", ".join(f"{value:.4g}" for value in overlap["point_mm"]),
        ]
        for overlap in document["interference"]
    ]
    gaps = [[gap["part"], gap["nearest"], number(gap["gap_mm"], 4)] for gap in document["gaps"]]
    inner = []
    if overlaps:
        columns = ["parts", "volume [mm3]", "depth [mm]", "at x y z [mm]"]
        inner.append(table("Overlaps that are no fits", columns, overlaps, " nn"))
    if fits:
        columns = ["parts", "kind", "depth [mm]", "a fit up to [mm]", "volume [mm3]"]
        inner.append(table("Fits that are drawn as overlaps", columns, fits, "  nnn"))
    if gaps:
        columns = ["part", "nearest part", "gap [mm]"]
        inner.append(table("Parts that touch no other", columns, gaps, "  n"))
    content = join(inner) if inner else note("No parts overlap, and every part touches another.")
    return Section("overlaps", "Fits, overlaps and gaps", content)


def _build_nests(document: _Document) -> list[Section]:
    """Return the section of nests with their drawings; none without nests."""
    nests = document.get("nests", [])
    if not nests:
        return []
    inner = []
    for nest in nests:
        words = f"{nest['name']} for {', '.join(nest['parts'])}, from above and in section."
        lines = tag("ul", {}, *(tag("li", {}, line) for line in list_nest_facts(nest)))
        inner += [caption_picture(draw_nest(nest), nest["name"], words), lines]
    return [Section("nests", "Nests", join(inner))]


def _build_remarks(document: _Document) -> Section:
    """Return assumptions, warnings and limits of one arm, and the options of the import."""
    limits = document.get("limits", {})
    lines = [
        *document["notes"],
        *document["warnings"],
        *(f"{name} {words}" for name, several in limits.items() for words in several),
    ]
    about = facts(
        [
            ("File", document["source"]),
            ("Unit", document["unit"]),
            ("Tolerance", f"{document['tolerance_mm']:g} mm"),
            ("Chord", f"{document['chord_mm']:g} mm"),
            ("Directions", document["directions"]),
            ("Threads", document["threads"]),
        ]
    )
    remarks = tag("ul", {}, *(tag("li", {}, line) for line in lines))
    return Section("remarks", "What was assumed", join([about, remarks]))
