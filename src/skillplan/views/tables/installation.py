"""Tables of plugins, the verdict cache, imported products, and listings of domains."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel

from skillplan.domains.domain import Listing
from skillplan.pipeline.registry import PluginInfo
from skillplan.records.cache import CacheFilling, CacheSurvey, CacheTest
from skillplan.views.figures.nest_figure import list_nest_facts
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import IN_PLACE


def tabulate_listing(listing: Listing) -> Table:
    """Return a domain's listing as a table, with columns of numbers aligned to the right."""
    columns = []
    for index, heading in enumerate(listing.columns):
        cells = [row[index] for row in listing.rows]
        columns.append(Column(heading, right=all(_is_figure(cell) for cell in cells)))
    return Table(listing.title, columns, listing.rows, listing.notes)


def _is_figure(cell: str) -> bool:
    return cell in ("-", "") or cell.replace(".", "", 1).lstrip("-").isdigit()


_BOUNDS = {"minimum": ">= ", "exclusiveMinimum": "> ", "maximum": "<= ", "exclusiveMaximum": "< "}


def tabulate_plugins(
    infos: Sequence[PluginInfo],
    options: type[BaseModel] | None,
    presets: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> list[Table]:
    """Return the plugins, and the options and presets of a single one."""
    headings = ("kind", "name", "distribution", "version", "what it does")
    rows = [
        (
            info.kind,
            info.name,
            info.distribution,
            info.version,
            f"BROKEN: {info.problem}" if info.problem else info.summary,
        )
        for info in infos
    ]
    tables = [Table("installed plugins", [Column(heading) for heading in headings], rows)]
    if options is not None:
        tables.append(_tabulate_options(infos[0].name, options, presets))
    return tables


def _tabulate_options(
    name: str, options: type[BaseModel], presets: Mapping[str, Mapping[str, Any]]
) -> Table:
    properties = options.model_json_schema().get("properties", {})
    rows = [
        (
            key,
            _format_type(field),
            _format_default(field),
            _format_range(field),
            str(field.get("description", "")),
        )
        for key, field in properties.items()
    ]
    headings = ("option", "type", "default", "range", "what it is [unit]")
    title = f"options of {name}" if rows else f"{name} has no options"
    notes = [f"--preset {preset}  {_join(values)}" for preset, values in presets.items()]
    return Table(title, [Column(heading) for heading in headings], rows, notes)


def _join(values: Mapping[str, Any]) -> str:
    """Return options in the syntax of ``-O``."""
    texts = {key: v if isinstance(v, str) else json.dumps(v) for key, v in values.items()}
    return ", ".join(f"{key}={text}" for key, text in texts.items())


def _format_default(field: Mapping[str, Any]) -> str:
    """Return the default of an option in the syntax of files and ``-O``."""
    default = field.get("default", "required")
    return default if isinstance(default, str) else json.dumps(default)


def _format_type(field: Mapping[str, Any]) -> str:
    """Return the type of an option; for an optional one, the type of its value."""
    kinds = [kind.get("type") for kind in field.get("anyOf", ())]
    return str(field.get("type") or " or ".join(str(k) for k in kinds if k != "null") or "any")


def _format_range(field: Mapping[str, Any]) -> str:
    """Return the bounds of an option, or its allowed words."""
    kinds = (field, *field.get("anyOf", ()))
    for kind in kinds:
        if "enum" in kind or "const" in kind:
            return " or ".join(str(word) for word in kind.get("enum", [kind.get("const")]))
    for kind in kinds:
        bounds = [f"{sign}{kind[bound]}" for bound, sign in _BOUNDS.items() if bound in kind]
        if bounds:
            return ", ".join(bounds)
    return "-"


def tabulate_survey(survey: CacheSurvey) -> Table:
    """Return a row for every back end and task."""
    columns = [
        Column("back end"),
        Column("task"),
        *(Column(name, right=True) for name in ("verdicts", "feasible", "infeasible")),
        *(Column(name, right=True) for name in ("size", "newest", "oldest", "took [s]")),
    ]
    rows = [
        (
            row["back_end"],
            row["task"],
            f"{row['verdicts']:,}",
            f"{row['feasible']:,}",
            f"{row['infeasible']:,}",
            _format_size(row["size_bytes"]),
            _format_age(row["newest_s"]),
            _format_age(row["oldest_s"]),
            f"{row['took_s']:.1f}",
        )
        for row in survey.rows()
    ]
    notes = [f"folder  {survey.folder}"]
    if survey.kept:
        total_s = sum(entry.record.took_s for entry in survey.kept)
        notes.append(f"saved   {total_s:.1f} s of checks, whenever all of them are needed")
    if survey.others:
        notes.append(
            f"{survey.others} more files are damaged, unfinished or of an earlier version: "
            "'skillplan cache clear' removes them."
        )
    title = "verdicts kept"
    if survey.task is not None:
        title = f"{survey.task.name}: verdicts that it would use"
    return Table(f"{title}: {len(survey.kept):,}", columns, rows, notes)


def tabulate_cache_test(test: CacheTest) -> Table:
    """Return a row for every rechecked verdict."""
    columns = [Column(name) for name in ("back end", "skill", "kept", "fresh")]
    columns += [Column("differs in"), Column("rests on", below=True)]
    rows = [
        (
            row["back_end"],
            row["skill"],
            row["kept"]["status"],
            "same" if row["same"] else row["fresh"]["status"],
            ", ".join(row["differs_in"]) or "-",
            ", ".join([*row["present"], *(f"not {name}" for name in row["absent"])]) or "no fact",
        )
        for row in test.document()["rows"]
    ]
    notes = [f"tried {len(test.trials)} of {test.kept:,} kept verdicts, seed {test.seed}"]
    if not test.kept:
        notes = ["Nothing is kept that this task would use: 'skillplan cache fill' does that."]
    elif test.different:
        stuck = len(test.different) - test.dropped
        notes.append(f"{len(test.different)} are different and have been dropped")
        if stuck:
            notes[-1] = f"{len(test.different)} are different; {stuck} could not be removed"
    elif test.elsewhere:
        held = "every one of them holds in another state, too"
        notes.append(held if test.trials else "none of them could be tried in another state")
    elif test.trials:
        notes.append("every one of them is the same, bit for bit")
    if test.nowhere_else:
        notes.append(f"{test.nowhere_else} apply in no other state that was found")
    if test.interrupted:
        notes.append("interrupted")
    return Table(f"{test.task.name}: kept verdicts checked again", columns, rows, notes)


def tabulate_filling(filling: CacheFilling) -> Table:
    """Return the counts in one row."""
    counts = filling.counts
    columns = [
        Column("states", right=True),
        Column("questions", right=True, short="queries"),
        *(Column(name, right=True) for name in ("feasible", "executions", "by state", "s")),
    ]
    figures = (
        counts.states,
        counts.queries,
        counts.feasible,
        counts.executions,
        counts.executions_by_state,
    )
    rows = [(*(f"{figure:,}" for figure in figures), f"{filling.wall_s:.1f}")]
    notes = [
        "by state: executions with verdicts kept by state and skill instead of by facts",
        "nothing is kept on disk" if filling.folder is None else f"kept in {filling.folder}",
    ]
    if counts.unknown:
        notes.append(f"{counts.unknown:,} queries could not be decided")
    if not counts.complete:
        notes.append("interrupted: what was decided by then is kept")
    title = f"{filling.task.name}: complete feasibility by {', '.join(filling.back_ends)}"
    return Table(title, columns, rows, notes)


def tabulate_clearing(folder: Path, task: str | None, removed: int) -> Table:
    """Return the number of removed files."""
    columns = [Column("of"), Column("files removed", right=True)]
    rows = [("all tasks" if task is None else task, f"{removed:,}")]
    return Table("kept verdicts removed", columns, rows, [f"folder  {folder}"])


def _format_size(size_bytes: int) -> str:
    return f"{size_bytes / 1000:,.1f} kB"


def _format_age(age_s: float) -> str:
    for unit, length_s in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if age_s >= length_s:
            return f"{age_s / length_s:.0f} {unit}"
    return f"{age_s:.0f} s"


# Largest number of names in a row of reasons, and of parts in the table of parts.
_MOST_NAMES, _MOST_PARTS = 3, 40


def tabulate_import(
    document: Mapping[str, Any], lines: Sequence[str], advice: Sequence[str], *, whole: bool
) -> list[Table]:
    """Return a table of parts, and a table of the parts in the task and of the others by reason.

    Parameters
    ----------
    document
        ``skillplan.import/1``.
    lines
        Findings in words, below the first table.
    advice
        Lines below the second table.
    whole
        True for a row for every part, False for at most 40.
    """
    parts = document["parts"]
    why = {name: group["kind"] for group in _list_reasons(document) for name in group["parts"]}
    columns = [
        Column("part"),
        Column("kind"),
        Column("mass [kg]", right=True),
        Column("size [mm]", right=True),
        Column("free directions", right=True),
        Column("in the task"),
    ]
    rows = [
        (
            part["name"],
            part["kind"],
            f"{part['mass_kg']:.4g}",
            " x ".join(f"{side:.4g}" for side in part["size_mm"]),
            str(len(part["free"])),
            f"no: {why[part['name']]}" if part["name"] in why else "yes",
        )
        for part in (parts if whole else parts[:_MOST_PARTS])
    ]
    notes = list(lines)
    if len(rows) < len(parts):
        notes.insert(0, f"{len(parts) - len(rows)} more parts: --format csv lists all")
    title = f"{document['product']}: imported"
    return [Table(title, columns, rows, notes), _tabulate_reasons(document, advice)]


def tabulate_nests(document: Mapping[str, Any], out: str) -> list[Table]:
    """Return a table of nests with their checks, one row each.

    Parameters
    ----------
    document
        ``skillplan.nest/1``.
    out
        Folder of the files.
    """
    columns = [
        Column("nest"),
        Column("size [mm]", right=True),
        Column("held [mm]", right=True),
        Column("least gap [mm]", right=True),
        Column("rays", right=True),
        Column("pins", right=True),
        Column("pieces", right=True),
        Column("check"),
    ]
    rows, notes = [], []
    for nest in document["nests"]:
        check = nest["check"]
        rows.append(
            (
                nest["name"],
                " x ".join(f"{size:.4g}" for size in nest["size_mm"]),
                f"{nest['depth_mm']:.4g}",
                f"{check['least_gap_mm']:.3f}" if check["gap_at_mm"] else "5 or more",
                f"{check['rays']}",
                str(len(nest["pins"])),
                str(nest["pieces"]),
                "good" if check["good"] else "not good",
            )
        )
        notes += [f"{nest['name']}: {line}" for line in list_nest_facts(nest)]
        x, y, z = (f"{value:g}" for value in nest["seated_mm"])
        notes.append(
            f"{nest['name']}: the centre of the part's bottom sits {x} {y} {z} mm from that of the "
            "nest's"
        )
    if document["good"]:
        lacking = [nest["name"] for nest in document["nests"] if "obj" not in nest["files"]]
        meshes = "" if lacking else "OBJ for a fixture in a task (m), "
        notes += [
            f"{name}: no OBJ for a task: its surface has more corners or pieces than a task accepts"
            for name in lacking
        ]
        notes.append(f"{out} holds STL to print (mm), {meshes}drawings")
    else:
        notes.append(f"{out} holds drawings and nest.json, but no meshes of what is not good")
    parts = sorted({part for nest in document["nests"] for part in nest["parts"]})
    about = ", ".join(parts[:3]) + (f" and {len(parts) - 3} more" if len(parts) > 3 else "")
    return [Table(f"{document['kind']} for {about}", columns, rows, notes)]


def _list_reasons(document: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    reasons: Sequence[Mapping[str, Any]] = document["summary"]["left_out"]
    return reasons


def _tabulate_reasons(document: Mapping[str, Any], advice: Sequence[str]) -> Table:
    """Return the parts in the task and the others by reason, with counts."""
    summary = document["summary"]
    in_task = summary["in_task"]
    rows = [("in the task", str(len(in_task)), "-", _name_first(in_task))]
    title = f"{document['product']}: {len(in_task)} of {summary['parts']} parts in the task"
    if in_place := document.get("in_place"):
        rows.append((IN_PLACE, str(len(in_place)), "-", _name_first(in_place)))
        title += f", {len(in_place)} of them in place from the start"
    for reason in _list_reasons(document):
        causes = [
            f"{cause['part']} ({cause['count']})" if cause["count"] > 1 else cause["part"]
            for cause in reason["by"]
        ]
        names = reason["parts"]
        rows.append((reason["why"], str(len(names)), _name_first(causes), _name_first(names)))
    columns = [
        Column("parts by reason"),
        Column("count", right=True),
        Column("because of"),
        Column("names"),
    ]
    return Table(title, columns, rows, list(advice))


def _name_first(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMES
    shown = ", ".join(names[:_MOST_NAMES]) or "-"
    return f"{shown} and {more} more" if more > 0 else shown
