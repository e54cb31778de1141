"""A result in the place of a task file: what it says of its origin, but for what the line says."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.options.shared import BackEnds, PartReading
from skillplan.cli.options.values import parse_options, split_names

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.restoration import LoadedResult
    from skillplan.records.certificate import Certificate

# A page or picture does not wait longer for a verification [s]; `verify` has a limit of its own.
_VERIFICATION_S = 10.0
RESULT_HELP = "a result.json of search-optimal, or the folder that --out named"
ResultFile = Annotated[
    str,
    typer.Argument(metavar="RESULT", help=f"{RESULT_HELP.capitalize()}.", show_default=False),
]


def load(
    path: str,
    reading: PartReading,
    back_ends: BackEnds,
    *,
    solver: str | None = None,
    task_file: str | None = None,
    changed_task: bool = False,
    executor: str = "local",
) -> LoadedResult:
    """Return a result with its task.

    Parameters
    ----------
    path
        Of the result.
    reading, back_ends
        What goes before what the result says; what ``--set`` changes makes another task of it.
    solver
        The one that options without a plugin's name are for; None where there is none.
    task_file
        The task file; None for the one that the result names.
    changed_task
        Whether the task may be another one than was solved.
    executor
        Where jobs are done, as ``NAME`` or ``NAME:ADDRESS``.

    Raises
    ------
    OptionError
        If the result cannot be used, or an option is wrong.
    """
    from skillplan.cli.writing import tell
    from skillplan.pipeline.restoration import Override, load_result
    from skillplan.workers.executor import ExecutorChoice

    options = parse_options(back_ends.options, solver)
    place = ExecutorChoice.read(executor, options)
    options.pop(place.name, None)
    override = Override(
        task_file,
        reading.part,
        reading.settings(),
        back_ends.physics,
        tuple(split_names(back_ends.collision or "")),
        options,
    )
    changed = changed_task or bool(reading.changes)
    loaded = load_result(path, override, changed_task=changed)
    if loaded.times_note:
        tell(f"skillplan: warning: {path}: does not count {loaded.times_note}.")
    chosen = replace(
        back_ends,
        physics=back_ends.physics or loaded.origin.physics,
        collision=back_ends.collision or ",".join(loaded.origin.collision) or None,
    )
    # Options are for who takes part.
    solvers = () if solver is None else (solver,)
    chosen.setup(loaded.problem.tasks[-1], solvers, executor=executor)
    return replace(loaded, setup=replace(loaded.setup, executor=place))


def verify_before_showing(path: str, time_limit_s: float | None) -> Certificate:
    """Verify a result whose claims are about to be shown, with verdicts kept on disk.

    Parameters
    ----------
    path
        Of the result.
    time_limit_s
        Time limit of the command [s]; None for none. The verification takes 10 s at most.

    Raises
    ------
    OptionError
        If a claim fails: then none is shown.
    """
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import OptionError
    from skillplan.pipeline.certification import certify
    from skillplan.pipeline.solving import warm_cache

    limit_s = min(_VERIFICATION_S, time_limit_s or _VERIFICATION_S)
    with stoppable(limit_s, label="verifying") as stop:
        certificate = certify(path, stop=stop, cache=warm_cache())
    if certificate.refuted:
        claim = certificate.refuted[0]
        raise OptionError(
            f"{path}: is not shown, as it is refuted: {claim.claim}: {claim.detail}. "
            f"`skillplan verify {path}` checks all claims."
        )
    return certificate
