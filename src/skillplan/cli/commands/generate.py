"""``skillplan generate``."""

from __future__ import annotations

import click

from skillplan import __version__
from skillplan.cli.command_group import CommandGroup
from skillplan.cli.options import Fraction, seed_option


@click.group("generate", cls=CommandGroup)
def command() -> None:
    """Write task files at random, of a kind: for studies of scale.

    The same arguments write the same file.
    """


@command.command("assembly", short_help="A board: many parts, a chart, several tools.")
@click.option(
    "--parts",
    type=click.IntRange(1, 256),
    required=True,
    metavar="N",
    help="How many parts, at most 256.",
)
@click.option(
    "--density",
    type=Fraction(),
    required=True,
    metavar="D",
    help="Share of all pairs of parts that the chart orders, what follows from it included: 0 for "
    "no chart, 1 for one order only.",
)
@click.option(
    "--tools",
    type=click.IntRange(1, 8),
    default=1,
    show_default=True,
    metavar="K",
    help="How many tools; each part has one of them, at random.",
)
@seed_option
@click.option("--name", default="", metavar="NAME", help="The task's name; default: from the rest.")
@click.option("--out", metavar="FILE", help="Write to FILE, a new one; default: to stdout.")
def assembly(parts: int, density: float, tools: int, seed: int, name: str, out: str | None) -> int:
    """Write an assembly task with N parts to be picked and placed, with a hand-made chart.

    Shapes, starts and goals depend on the seed only, so that boards of several densities can be
    compared; of two charts of the same parts the denser holds the other. By their geometry all
    orders are possible.
    """
    import os

    from skillplan.cli.writing import write_out
    from skillplan.domains.assembly.board_generator import BoardGenerator
    from skillplan.errors import OptionError
    from skillplan.files.atomic_file import write_whole
    from skillplan.files.output_path import output_path, refusing

    board = BoardGenerator(parts, density, tools, seed, name)
    text = board.text(__version__)
    if out is None:
        write_out(text)
        return 0
    path = output_path("--out", out, (".yaml", ".yml"), "task files")
    if os.path.lexists(path):
        raise OptionError(f"--out {out}: is there already. Name a new file.")
    with refusing("--out", path):
        write_whole(path, text)
    write_out(f"{out}: {board.summary}\n")
    return 0
