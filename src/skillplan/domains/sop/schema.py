"""The schema of a sequential ordering problem: a matrix of costs that says the order, too."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from skillplan.domains.domain import Strict
from skillplan.files.schema_errors import shown

BEFORE = -1
"""The entry in row i and column j that says that j comes before i."""

MOST_NODES = 2000
MOST_COST = 2**40

_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}$"


def _named(name: str) -> str:
    if re.fullmatch(_NAME, name) is None:
        raise ValueError(
            f"{shown(name)} is not a name. Use letters, digits and '_.+-', at most 64."
        )
    return name


Entry = Annotated[int, Field(ge=BEFORE, le=MOST_COST)]


class SopConfig(Strict):
    """A sequential ordering problem, as TSPLIB defines it."""

    kind: Literal["sop"] = Field(description="the kind of task file")
    name: Annotated[str, AfterValidator(_named)] = Field(
        description="the task's name", json_schema_extra={"pattern": _NAME}
    )
    description: str = Field("", description="for people")
    costs: Annotated[list[list[Entry]], Field(min_length=2, max_length=MOST_NODES)] = Field(
        description="a row for each node: what going on to each one costs, or -1 where that one "
        "comes before it"
    )
