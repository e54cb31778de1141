"""Queries answered at once, so that no answer is worked out twice."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from skillplan.checks.deciding import Checking
from skillplan.checks.single_check import Checked, CheckRequest
from skillplan.errors import BackEndError
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict


class QueryBatch:
    """Queries and their verdicts.

    Those about one skill are queried one after the other, as the verdict on the first may answer
    the rest; no verdict says anything about a skill of another lane.

    Parameters
    ----------
    rule
        Begins to check.
    queries
        Pairs of skill and state.
    lane
        The name that skills share where an answer about one may be one about another.

    Attributes
    ----------
    lanes
        A conversation for every skill, or those of one lane.
    """

    def __init__(
        self,
        rule: Callable[[Skill, State], Checking],
        queries: Sequence[tuple[Skill, State]],
        lane: Callable[[Skill], str],
    ) -> None:
        self._rule = rule
        self._queries = queries
        self._verdicts: dict[int, Verdict] = {}
        self._errors: dict[int, BackEndError] = {}
        by_skill: dict[str, list[int]] = {}
        for position, (skill, _) in enumerate(queries):
            by_skill.setdefault(lane(skill), []).append(position)
        self._by_name = {name: Lane(self, positions) for name, positions in by_skill.items()}
        self.lanes = list(self._by_name.values())

    def asks(self, lane: str) -> bool:
        """Whether a lane has not come to its end."""
        return lane in self._by_name and self._by_name[lane].open

    def begin(self, position: int) -> Checking:
        """Begin to decide about a query."""
        return self._rule(*self._queries[position])

    def settle(self, position: int, verdict: Verdict) -> None:
        """Note the verdict on a query."""
        self._verdicts[position] = verdict

    def fail(self, position: int, error: BackEndError) -> None:
        """Note that a back end failed on a query."""
        self._errors[position] = error

    def matters(self, position: int) -> bool:
        """Whether no earlier query has failed."""
        return not self._errors or position < min(self._errors)

    def verdicts(self) -> list[Verdict]:
        """Return the verdicts in the order of the queries, once all lanes have come to an end.

        Raises
        ------
        BackEndError
            That of the first query on which a back end failed.
        """
        if self._errors:
            raise self._errors[min(self._errors)]
        return [self._verdicts[position] for position in range(len(self._queries))]


class Lane:
    """The queries of a batch about one skill, in order.

    Parameters
    ----------
    batch
        Whose queries they are.
    positions
        Their positions in it.
    """

    def __init__(self, batch: QueryBatch, positions: Sequence[int]) -> None:
        self._batch = batch
        self._left = deque(positions)
        self._at = -1
        self._checking: Checking | None = None

    @property
    def open(self) -> bool:
        """Whether a query is left or under way."""
        return bool(self._left) or self._checking is not None

    @property
    def wanted(self) -> bool:
        """Whether an answer still matters."""
        return self._batch.matters(self._at)

    def go_on(self, said: Checked | None) -> CheckRequest | None:
        """Return what is to be checked next, given what was said to the last; None at the end."""
        while True:
            try:
                if self._checking is not None and said is not None:
                    return self._checking.send(said)
                if not self._left or not self._batch.matters(self._left[0]):
                    return None
                self._at = self._left.popleft()
                self._checking = self._batch.begin(self._at)
                return next(self._checking)
            except StopIteration as end:
                self._batch.settle(self._at, end.value)
                self._checking = None
            except BackEndError as error:
                self.fail(error)
                return None

    def fail(self, error: BackEndError) -> None:
        """Take it that a back end failed on what was to be checked."""
        self._batch.fail(self._at, error)
