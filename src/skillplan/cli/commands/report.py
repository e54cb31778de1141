"""``skillplan report``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options import shared
from skillplan.cli.options.completion import task_files
from skillplan.cli.options.shared import RESULT_HELP
from skillplan.cli.options.values import option


def command(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK|RESULT|RUN...",
            autocompletion=task_files,
            help=f"Task files; {RESULT_HELP}; outputs of compare --format json; or folders of "
            "train. One or several, each a chapter.",
            show_default=False,
        ),
    ],
    *,
    out: Annotated[
        str,
        option(
            "--out FILE", shared.OUTPUT, "The page, .html; must be a new file.", show_default=False
        ),
    ],
    reading: shared.ResultReading,
    back_ends: shared.BackEnds,
    seed: shared.Seed = 0,
    limits: shared.CommandLimits,
    no_simulation: Annotated[
        bool,
        option(
            "--no-simulation",
            shared.BACK_ENDS,
            "Do not simulate plans: play the arm along its planned paths, without forces.",
        ),
    ] = False,
) -> int:
    """Write an HTML page on plans, comparisons and trainings, with a playback in 3-D.

    A TASK is solved first. A RESULT is verified first, for at most 10 s: refuted results are not
    shown, and the page lists unverified claims. The page shows the plan with its times, the
    precedence relation with reasons, refusals, and how the result was proved. It needs no network;
    without JavaScript only the playback is missing. The first plan is played: for an arm as an
    engine executes it, or along its planned paths if no engine is installed; for a chain by its
    times. After --time-limit, the page is written without the missing parts and names them.
    """
    from pathlib import Path

    from skillplan.cli.output import write_new_file
    from skillplan.cli.report_inputs import Reporter
    from skillplan.cli.writing import tell, write_out
    from skillplan.errors import OptionError, exit_code
    from skillplan.files.output_path import check_output_path
    from skillplan.views.report.page import HOW_TO_GET, load_player, render_page

    deadline = limits.begin(graceful=True)
    path = check_output_path("--out", out, SUFFIXES, "pages")
    if Path(path).exists():
        raise OptionError(f"--out {out}: is there already. Name a new file.")
    web_player = load_player()
    if web_player is None:
        words = "the page has no playback in 3-D, whose player is not here"
        tell(f"skillplan: note: {words}: {HOW_TO_GET}.")
    plays = web_player is not None
    reporter = Reporter(reading, back_ends, deadline, not no_simulation, plays, seed)
    chapters = [
        reporter.chapter(file, f"c{number}", 1 / (len(inputs) - number + 1))
        for number, file in enumerate(inputs, start=1)
    ]
    title = chapters[0].heading if len(chapters) == 1 else f"{len(chapters)} reports"
    html = render_page(title, chapters, reporter.playback, web_player)
    write_new_file(out, html, SUFFIXES, "pages")
    write_out(f"{out}\n")
    return exit_code(interrupted=reporter.interrupted)


SUFFIXES = (".html",)
