"""The lattice of the file that a figure is requested of."""

from __future__ import annotations

from skillplan.domains.domain import Account
from skillplan.views.figures.figure_request import FigureRequest
from skillplan_swarmitfix.bench.bench import Bench


def requested_bench(request: FigureRequest, account: Account | None = None) -> Bench:
    """Return the lattice of a request's file.

    Parameters
    ----------
    request
        What the user wants drawn.
    account
        What the domain derives from a solved file; None for what it derives from the file alone.

    Raises
    ------
    OptionError
        If the file is of another kind.
    """
    known = request.problem.account({}) if account is None else account
    shape = known.document.get("bench")
    if shape is None:
        raise request.unfit(
            f"it shows a bench, but the file is of kind {request.problem.kind}. Figures of any "
            "kind are rewards, learning and q-values"
        )
    return Bench(shape["rows"], shape["cols"], shape["pitch_m"], shape["actions"])
