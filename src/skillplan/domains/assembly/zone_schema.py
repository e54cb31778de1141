"""YAML schema of zones: keep-out zones of arm and load, and areas of people."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from skillplan.domains.assembly.schema_types import Coordinate, Planar, is_absent
from skillplan.domains.domain import Strict
from skillplan.files.schema_errors import Located
from skillplan.task.zone import CEILING_M, Mover, Zone

_MOVERS: dict[str | None, tuple[Mover, ...]] = {
    "arm": ("arm",),
    "load": ("load",),
    "all": ("arm", "load"),
    None: (),
}


class ZoneConfig(Strict):
    """A zone over a polygon or a rectangle, which arm or load stay out of, or cross slowly."""

    polygon_m: Annotated[list[Planar], Field(min_length=3, max_length=64)] | None = Field(
        None,
        exclude_if=is_absent,
        description="corners x y in order [m]; instead of min_m and max_m",
    )
    min_m: Planar | None = Field(
        None,
        exclude_if=is_absent,
        description="least x and y of a rectangle [m]; left out: polygon_m",
    )
    max_m: Planar | None = Field(
        None,
        exclude_if=is_absent,
        description="greatest x and y of a rectangle [m]; left out: polygon_m",
    )
    height_m: Annotated[list[Coordinate], Field(min_length=1, max_length=2)] | None = Field(
        None,
        exclude_if=is_absent,
        description="heights of bottom and top [m], or of the bottom only: open above; left out: "
        "from the table up",
    )
    keeps_out: Literal["arm", "load", "all"] | None = Field(
        None,
        exclude_if=is_absent,
        description="what must not enter. arm: links, hand and tool; load: carried parts and "
        "screws; all: both; left out: all, or with speed_m_per_s nothing",
    )
    speed_m_per_s: Annotated[float, Field(gt=0, le=10)] | None = Field(
        None,
        exclude_if=is_absent,
        description="greatest speed of the tip while it is inside [m/s], such as 0.25 near people; "
        "left out: no limit",
    )

    @model_validator(mode="after")
    def _one_area(self) -> ZoneConfig:
        if self.polygon_m is not None:
            for key in ("min_m", "max_m"):
                if getattr(self, key) is not None:
                    raise Located("give polygon_m, or min_m and max_m, not both.", key)
            _require_area(self.polygon_m)
        elif self.min_m is None or self.max_m is None:
            raise Located("give 'polygon_m', or 'min_m' and 'max_m'.")
        elif not (self.min_m[0] < self.max_m[0] and self.min_m[1] < self.max_m[1]):
            raise Located("must be above min_m in x and in y.", "max_m")
        return self

    @model_validator(mode="after")
    def _some_height(self) -> ZoneConfig:
        if self.low_m >= self.high_m:
            raise Located(
                f"the top, {self.high_m:g} m, must be above the bottom, {self.low_m:g} m.",
                "height_m",
            )
        if self.speed_m_per_s is not None and self.keeps_out in ("arm", "all"):
            raise Located(
                "has no effect, as the arm stays out. Leave it out, or give keeps_out: load.",
                "speed_m_per_s",
            )
        return self

    @property
    def low_m(self) -> float:
        """Height of the bottom [m]."""
        return 0.0 if self.height_m is None else self.height_m[0]

    @property
    def high_m(self) -> float:
        """Height of the top [m]; far above the arm if it is open above."""
        is_open = self.height_m is None or len(self.height_m) < 2
        return max(CEILING_M, self.low_m + 1.0) if is_open else self.height_m[1]  # type: ignore[index]

    def build(self, name: str) -> Zone:
        """Return the zone of the scene."""
        if self.polygon_m is not None:
            corners = tuple((x, y) for x, y in self.polygon_m)
        else:
            assert self.min_m is not None
            assert self.max_m is not None
            (x, y), (a, b) = self.min_m, self.max_m
            corners = ((x, y), (a, y), (a, b), (x, b))
        keeps_out = "all" if self.speed_m_per_s is None else None
        movers = _MOVERS[self.keeps_out or keeps_out]
        return Zone(name, corners, self.low_m, self.high_m, movers, self.speed_m_per_s)


def _require_area(polygon: list[list[float]]) -> None:
    """Raise if the sides of a polygon cross, or if it has no area."""
    import shapely

    shape = shapely.Polygon(polygon)
    if shapely.MultiPoint(polygon).convex_hull.area < 1e-9:
        raise Located("has no area. Give corners that are not on a line.", "polygon_m")
    if not shape.is_valid:
        where = shapely.is_valid_reason(shape).partition("[")[2].rstrip("]").split()
        at = f" at ({float(where[0]):.4g}, {float(where[1]):.4g}) m" if len(where) == 2 else ""
        raise Located(f"its sides cross{at}. Give the corners in order.", "polygon_m")
