"""How a task is presented to a learner: names of observations, masks and objectives."""

from __future__ import annotations

from typing import Any, Literal, get_args

from skillplan.errors import OptionError, name_hint

ObservationKind = Literal["paper", "markov", "layout"]
MaskKind = Literal["none", "applicable", "feasible"]
Objective = Literal["reward", "cost"]


def checked_name(what: str, name: str, kinds: Any) -> Any:
    """Return a name if it is one of a kind's.

    Parameters
    ----------
    what
        What is named, for the message.
    name
        The name to check.
    kinds
        One of the types of this file.

    Raises
    ------
    OptionError
        If it is not; the message says which there are.
    """
    known = get_args(kinds)
    if name not in known:
        raise OptionError(f"Unknown {what} {name!r}. {name_hint(str(name), known)}")
    return name
