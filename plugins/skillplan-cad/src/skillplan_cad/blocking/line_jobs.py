"""Blocking along several lines at once, each in a process; what is found is the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

from skillplan.errors import BackEndError
from skillplan.workers.executor import Answer, Ended, Worker, packed
from skillplan.workers.local_processes import LocalProcesses
from skillplan_cad.blocking.all_pairs import Answers, BlockingTest
from skillplan_cad.product import Product, Vector

_WHAT = "blocking"

Job = tuple[Vector, int, int]


def answers_of(
    product: Product, tolerance_m: float, lines: Sequence[Job], jobs: int
) -> Iterator[Answers]:
    """Yield what blocks what along each line and against it, as answers come.

    Parameters
    ----------
    product
        The product.
    tolerance_m
        Radius of the disc that has to be blocked.
    lines
        A direction of each, its number and that of the opposite one.
    jobs
        How many processes may be used; 1 for none but this one.

    Raises
    ------
    BackEndError
        If a process ended before it answered.
    """
    if jobs == 1 or len(lines) == 1:
        test = BlockingTest(product, tolerance_m)
        for line in lines:
            yield test.along(*line)
        return
    content = packed((product, tolerance_m), _WHAT)
    with closing(LocalProcesses(min(jobs, len(lines)))) as executor:
        left = list(lines)
        busy: list[Worker] = []
        while left and len(busy) < executor.slots:
            worker = executor.start(_prepare, content, _WHAT)
            worker.take(left.pop(0))
            busy.append(worker)
        while busy:
            for ready in executor.first_ready(busy):
                answer = ready.answer()
                if isinstance(answer, Ended):
                    if not answer.started and not answer.killed:
                        raise ready.not_started()
                    raise BackEndError(f"a process that tested blocking ended by {answer.how}")
                if not isinstance(answer, Answer):
                    continue
                yield answer.content
                if left:
                    ready.take(left.pop(0))
                else:
                    busy.remove(ready)
                    ready.end()


def _prepare(content: tuple[Product, float]) -> Callable[[Job], Answers]:
    """Return what a process does with a line."""
    test = BlockingTest(*content)
    return lambda line: test.along(*line)
