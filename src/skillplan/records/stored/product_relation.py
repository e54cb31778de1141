"""What blocks what in a product of CAD, from the files that `import-cad` writes beside a task."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.files.json_file import read_document
from skillplan.records import schemas
from skillplan.task.pose import Point

RELATION_FILE, REPORT_FILE = "relation.json", "report.json"
_REMEDY = "Write it anew with `skillplan import-cad`"
_M_PER_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A part in the way of another that moves along a direction.

    Parameters
    ----------
    part
        Its name in the task.
    distance_m
        How far the other moves until they meet.
    width_m
        Diameter of the largest disc that is blocked.
    point_m
        A point of it that is met, in the world of the task.
    sensitive
        Whether half or double the tolerance says otherwise.
    """

    part: str
    distance_m: float
    width_m: float
    point_m: Point
    sensitive: bool


@dataclass(frozen=True, slots=True)
class ProductRelation:
    """The relation of a product, in names and in the world of its task.

    Parameters
    ----------
    path
        Of `relation.json`.
    parts
        Names in the task, in the order of the file; those of the file of what the task leaves out.
    tolerance_m
        Radius of the disc that has to be blocked before a pair is.
    directions
        Unit vectors in the world, with those of the file that they stand for.
    obstacles
        For each part and direction, by its number, what is in its way.
    """

    path: Path
    parts: tuple[str, ...]
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


def relation_beside(task_file: Path) -> ProductRelation:
    """Return the relation of the product that a task puts together.

    Parameters
    ----------
    task_file
        A file that `import-cad` wrote.

    Raises
    ------
    OptionError
        If there is no relation beside it, or one of its files is not as it was written.
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
        return _relation(path, relation, report)
    except (KeyError, TypeError, ValueError) as error:
        raise OptionError(f"{path}: does not fit {REPORT_FILE}: {error!r}. {_REMEDY}.") from None


def _relation(path: Path, relation: dict[str, Any], report: dict[str, Any]) -> ProductRelation:
    # What the task leaves out keeps its name of the file.
    names = {str(name): str(name) for name in report.get("left_out", {})}
    names |= {str(name): str(own) for name, own in report["task_names"].items()}
    placement = report["placement"]
    turn = [_point(row) for row in placement["turn"]]
    offset_m = _scaled(_point(placement["offset_mm"]))

    def turned(vector: Point) -> Point:
        x, y, z = (sum(a * b for a, b in zip(row, vector, strict=True)) for row in turn)
        return (round(x, 9) + 0.0, round(y, 9) + 0.0, round(z, 9) + 0.0)

    of_file = [_point(one) for one in relation["directions"]]
    numbers = {one: number for number, one in enumerate(of_file)}
    found: dict[tuple[str, int], list[Obstacle]] = {}
    for one in relation["blocked"]:
        x, y, z = turned(_scaled(_point(one["point_mm"])))
        obstacle = Obstacle(
            names[one["by"]],
            one["distance_mm"] * _M_PER_MM,
            one["width_mm"] * _M_PER_MM,
            (x + offset_m[0], y + offset_m[1], z + offset_m[2]),
            bool(one["sensitive"]),
        )
        key = (names[one["part"]], numbers[_point(one["direction"])])
        found.setdefault(key, []).append(obstacle)
    return ProductRelation(
        path,
        tuple(names[one["name"]] for one in relation["parts"]),
        relation["tolerance_mm"] * _M_PER_MM,
        tuple((turned(one), one) for one in of_file),
        {key: tuple(sorted(those, key=_nearness)) for key, those in found.items()},
    )


def _nearness(obstacle: Obstacle) -> tuple[float, str]:
    return obstacle.distance_m, obstacle.part


def _point(values: Any) -> Point:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _scaled(point: Point) -> Point:
    return (point[0] * _M_PER_MM, point[1] * _M_PER_MM, point[2] * _M_PER_MM)
