"""The ranges that keys of a task file have in common: places, lengths, heights, angles."""

from typing import Annotated

from pydantic import Field

Coordinate = Annotated[float, Field(ge=-10, le=10)]
Planar = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Spatial = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
PlanarOrSpatial = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]
# Thinner than a micrometre, a box has no volume worth the name.
Extent = Annotated[float, Field(ge=1e-6, le=10)]
Length = Annotated[float, Field(gt=0, le=10)]
Extents = Annotated[list[Extent], Field(min_length=3, max_length=3)]
Height = Annotated[float, Field(ge=0, le=10)]
Angle = Annotated[float, Field(ge=-6.2832, le=6.2832)]
Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]
