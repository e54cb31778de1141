"""``skillplan check``."""

from __future__ import annotations

from skillplan.cli.load import load_file, make_setup, name_back_ends, open_cache
from skillplan.cli.options.shared import BackEnds, Caching, CommandLimits, Reading, Style, TaskFile


def command(
    task: TaskFile,
    back_ends: BackEnds,
    reading: Reading,
    caching: Caching,
    limits: CommandLimits,
    style: Style = "table",
) -> int:
    """Validate TASK: faults of YAML, keys, references, order and geometry.

    Also warns of problems that would show only in a search: parts too wide for jaws, feeders that
    are blocked at the start, drawings in a doubtful unit, cycles of the precedence relation, and a
    chart that contradicts it. That relation is derived by kinematic and the default detector (swept
    if it is installed, or else aabb), and for hollow parts only if a detector is named. --physics
    and --collision name other back ends, which also report their faults in the parts. Properties
    that the back ends of a search leave unchecked are listed.
    """
    from itertools import chain

    from skillplan.checks.single_check import introduce_back_ends, list_not_checked
    from skillplan.cli.output import emit
    from skillplan.pipeline.obstacles import preview_problem
    from skillplan.records.questions import Checked
    from skillplan.views.tables.questions import tabulate_checked

    limits.begin(graceful=False)
    problem = load_file(task, reading, back_ends, warn=False)
    setups = [make_setup(back_ends, task) for task in problem.tasks]
    back_ends_of = [
        introduce_back_ends(setup.back_ends(task))
        for setup, task in zip(setups, problem.tasks, strict=True)
    ]
    names = [[back_end.name for back_end in used] for used in back_ends_of]
    not_checked = list_not_checked(tuple(chain.from_iterable(back_ends_of)))
    first = setups[0]
    # Verdicts of instant checks are not worth a file.
    cache = open_cache(caching) if name_back_ends(back_ends) else None
    preview = preview_problem(problem, first.physics, first.collision, first.options, cache)
    checked = Checked(problem, names, preview, not_checked)
    emit(style, checked.document(), tabulate_checked(checked))
    return 0
