"""The blocking relation of a CAD product, from the files that `import-cad` writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.files.json_file import parse_json, read_document
from skillplan.files.regular_file import read_bytes
from skillplan.records import schemas
from skillplan.task.pose import Point

RELATION_FILE, REPORT_FILE = "relation.json", "report.json"
_REMEDY = "Write it anew with `skillplan import-cad`"
_M_PER_MM = 1e-3
_MOST_BYTES = 64 * 1024 * 1024
_FRAME_OF_FILE: dict[str, Any] = {"turn": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "offset_mm": [0, 0, 0]}


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A part in the way of another that moves along a direction.

    Parameters
    ----------
    part
        Name of the blocking part.
    distance_m
        Travel of the other part until they meet [m].
    width_m
        Diameter of the largest disc that is blocked [m].
    point_m
        A point of contact [m].
    sensitive
        True if half or double the tolerance gives another answer.
    """

    part: str
    distance_m: float
    width_m: float
    point_m: Point
    sensitive: bool


@dataclass(frozen=True, slots=True)
class ProductRelation:
    """The relation of a product, in names and in the world of its task, or of its CAD file.

    Parameters
    ----------
    path
        Path of `relation.json`.
    parts
        Names in the task, in the order of the file; parts not in the task keep their names.
    stuck
        Parts that no searched motion frees.
    tolerance_m
        Radius of the disc that must be blocked to count [m].
    directions
        Unit vectors in the world, with the vectors of the file that they stand for.
    obstacles
        Name of a part and number of a direction to the obstacles.
    """

    path: Path
    parts: tuple[str, ...]
    stuck: tuple[str, ...]
    tolerance_m: float
    directions: tuple[tuple[Point, Point], ...]
    obstacles: dict[tuple[str, int], tuple[Obstacle, ...]]

    def part(self, name: str) -> str:
        """Return the name of a part.

        Raises
        ------
        OptionError
            If there is none; the message has the nearest.
        """
        if name not in self.parts:
            hint = name_hint(name, self.parts)
            raise OptionError(f"{self.path}: there is no part {name!r}. {hint}")
        return name


def is_relation(path: Path) -> bool:
    """Return whether a file is a `relation.json`; False if it cannot be read."""
    if path.suffix.lower() != ".json":
        return False
    try:
        document = parse_json(read_bytes(path, _MOST_BYTES))
    except (OSError, ValueError):
        return False
    schema = document.get("schema") if isinstance(document, dict) else None
    kind = schemas.RELATION.partition("/")[0]
    return isinstance(schema, str) and schema.partition("/")[0] == kind


def read_relation(path: Path) -> ProductRelation:
    """Return a relation in the names and the frame of its CAD file.

    Raises
    ------
    OptionError
        If it is damaged or of another version.
    """
    relation = read_document(path, schemas.RELATION, _REMEDY)
    try:
        return _build_relation(path, relation, {}, _FRAME_OF_FILE)
    except (KeyError, TypeError, ValueError) as error:
        raise OptionError(f"{path}: is damaged: {error!r}. {_REMEDY}.") from None


def read_relation_beside(task_file: Path) -> ProductRelation:
    """Return the relation of the product that a task assembles.

    Parameters
    ----------
    task_file
        A file that `import-cad` wrote.

    Raises
    ------
    OptionError
        If the folder of the task has no relation, or one of its files was changed.
    """
    folder = task_file.parent
    path = folder / RELATION_FILE
    if not path.is_file():
        raise OptionError(
            f"{task_file}: there is no {RELATION_FILE} beside it, which says what is in a part's "
            "way. `skillplan import-cad` writes both from CAD; of other tasks, `explain TASK "
            "'place(PART)'` tells what stands against a skill."
        )
    relation = read_document(path, schemas.RELATION, _REMEDY)
    report = read_document(folder / REPORT_FILE, schemas.IMPORT, _REMEDY)
    try:
        # Parts that the task leaves out keep their names in the file.
        names = {str(name): str(name) for name in report.get("left_out", {})}
        names |= {str(name): str(own) for name, own in report["task_names"].items()}
        return _build_relation(path, relation, names, report["placement"])
    except (KeyError, TypeError, ValueError) as error:
        raise OptionError(f"{path}: does not fit {REPORT_FILE}: {error!r}. {_REMEDY}.") from None


def _build_relation(
    path: Path, relation: dict[str, Any], names: dict[str, str], placement: dict[str, Any]
) -> ProductRelation:
    """Return a relation; parts without an entry in `names` keep their names if it is empty."""
    names = names or {str(entry["name"]): str(entry["name"]) for entry in relation["parts"]}
    turn = [_point(row) for row in placement["turn"]]
    offset_m = _scaled(_point(placement["offset_mm"]))

    def turned(vector: Point) -> Point:
        x, y, z = (sum(a * b for a, b in zip(row, vector, strict=True)) for row in turn)
        return (round(x, 9) + 0.0, round(y, 9) + 0.0, round(z, 9) + 0.0)

    of_file = [_point(entry) for entry in relation["directions"]]
    numbers = {entry: number for number, entry in enumerate(of_file)}
    obstacles: dict[tuple[str, int], list[Obstacle]] = {}
    for entry in relation["blocked"]:
        x, y, z = turned(_scaled(_point(entry["point_mm"])))
        obstacle = Obstacle(
            names[entry["by"]],
            entry["distance_mm"] * _M_PER_MM,
            entry["width_mm"] * _M_PER_MM,
            (x + offset_m[0], y + offset_m[1], z + offset_m[2]),
            bool(entry["sensitive"]),
        )
        key = (names[entry["part"]], numbers[_point(entry["direction"])])
        obstacles.setdefault(key, []).append(obstacle)
    return ProductRelation(
        path,
        tuple(names[entry["name"]] for entry in relation["parts"]),
        tuple(names[name] for name in relation.get("stuck", ())),
        relation["tolerance_mm"] * _M_PER_MM,
        tuple((turned(entry), entry) for entry in of_file),
        {key: tuple(sorted(those, key=_nearness)) for key, those in obstacles.items()},
    )


def _nearness(obstacle: Obstacle) -> tuple[float, str]:
    return obstacle.distance_m, obstacle.part


def _point(values: Any) -> Point:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _scaled(point: Point) -> Point:
    return (point[0] * _M_PER_MM, point[1] * _M_PER_MM, point[2] * _M_PER_MM)
