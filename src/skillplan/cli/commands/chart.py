"""``skillplan chart``."""

from __future__ import annotations

from skillplan.cli.load import load_part, open_cache
from skillplan.cli.options import shared


def command(
    task: shared.TaskFile,
    back_ends: shared.BackEnds,
    reading: shared.PartReading,
    checking: shared.Checking,
    no_screening: shared.NoScreening = False,
    style: shared.Style = "table",
) -> int:
    """Derive the precedence relation of TASK by querying back ends.

    A hand-made chart of the task is compared with it: its relations that the derived ones do not
    imply are missing, derived relations that it does not imply are extra. The exit code is 3 if
    physics grants a skill that geometry has refused.
    """
    from contextlib import closing

    from skillplan.chart.precedence_chart import derive_chart
    from skillplan.checks.audit import SampleSize, draw_sample
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import show_checks
    from skillplan.cli.writing import tell
    from skillplan.errors import exit_code
    from skillplan.pipeline.screening import execute_sample
    from skillplan.pipeline.solving import make_feasibility
    from skillplan.records.questions import make_chart_document
    from skillplan.views.tables.questions import tabulate_chart

    # A chart derived from the chart would only repeat it.
    loaded, setup, constructed = load_part(
        task,
        reading,
        back_ends,
        executor=checking.executor,
        screening=not no_screening,
        with_chart=False,
    )
    cache = open_cache(checking)
    with show_checks("deriving") as on_check:
        feasibility = make_feasibility(
            loaded, setup, cache, jobs=checking.jobs, on_check=on_check, back_ends=constructed
        )
        with closing(feasibility):
            chart = derive_chart(feasibility)
            sample = execute_sample(feasibility.back_ends, draw_sample(feasibility, SampleSize()))
    names = [back_end.name for back_end in feasibility.back_ends]
    emit(style, make_chart_document(chart, loaded, names), [tabulate_chart(chart, loaded, names)])
    if sample.overruled:
        tell(f"skillplan: error: {sample.overruled}")
    return exit_code(back_end_failed=bool(sample.overruled))
