"""``skillplan generate``."""

from __future__ import annotations

from typing import Annotated

from skillplan import __version__
from skillplan.cli.options.shared import OUTPUT, TASK, Seed
from skillplan.cli.options.values import (
    Probabilities,
    count_option,
    fraction,
    option,
    probabilities,
)

HELP = """Write task files at random, of a kind: for studies of scale.

The same arguments write the same file.
"""


def assembly(
    parts: Annotated[
        int,
        count_option(
            "--parts", minimum=1, maximum=256, text="Number of parts.", rich_help_panel=TASK
        ),
    ],
    density: Annotated[
        float,
        option(
            "--density D",
            TASK,
            "Share of all pairs of parts that the chart orders, including implied pairs: 0 "
            "for no chart, 1 for a single order.",
            parser=fraction,
        ),
    ],
    tools: Annotated[
        int,
        count_option(
            "--tools",
            minimum=1,
            maximum=8,
            metavar="K",
            text="Number of tools; each part uses one of them at random.",
            rich_help_panel=TASK,
        ),
    ] = 1,
    seed: Seed = 0,
    name: Annotated[
        str, option("--name NAME", TASK, "Name of the task. Default: from the other options.")
    ] = "",
    failures: Annotated[
        Probabilities | None,
        option(
            "--failures P:Q",
            TASK,
            "Smallest and largest probability that a grasp fails, such as 0.1:0.4; the arm "
            "then goes home before it tries again. Default: no grasp fails.",
            parser=probabilities,
        ),
    ] = None,
    failing_share: Annotated[
        float,
        option(
            "--failing-share S",
            TASK,
            "Share of the parts whose grasp may fail, with --failures.",
            parser=fraction,
        ),
    ] = 1.0,
    out: Annotated[str | None, option("--out FILE", OUTPUT, "New file. Default: stdout.")] = None,
) -> int:
    """Write an assembly task with N parts to be picked and placed, with a hand-made chart.

    Shapes, starts and goals depend only on the seed, so boards of several densities can be
    compared. The denser of two charts of the same parts contains the other. Geometry allows all
    orders.
    """
    from skillplan.cli.output import write_new_file
    from skillplan.cli.writing import write_out
    from skillplan.domains.assembly.board_generator import BoardGenerator

    board = BoardGenerator(parts, density, tools, seed, name, failures, failing_share)
    text = board.text(__version__)
    if out is None:
        write_out(text)
        return 0
    write_new_file(out, text, (".yaml", ".yml"), "task files")
    write_out(f"{out}: {board.summary}\n")
    return 0


COMMANDS = {"assembly": assembly}
