"""The constraint model of an order: a circuit through all jobs, with a position for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ortools.sat.python import cp_model

from skillplan_ortools.whole_costs import START, WholeCosts


class OrderCircuit:
    """A constraint model whose solutions are orders of jobs.

    A circuit goes from a depot through all jobs and back. The position of a job is one after that
    of its predecessor in the circuit, and greater than the positions of all required predecessors.
    Alternatives prove less in the same time on most benchmark instances: positions that are only
    later, accumulated costs, pairwise orders, and all positions different.

    Parameters
    ----------
    network
        Arcs and precedence, with at least one job.
    most_skills
        Greatest number of skills in the plan; None for no limit.
    """

    def __init__(self, network: WholeCosts, most_skills: int | None = None) -> None:
        self.network = network
        self.model = cp_model.CpModel()
        # Arcs first: with this order of variables, proofs take half the time.
        self._taken = {arc: self.model.new_bool_var("") for arc in network.arcs}
        self._last = {
            job: self.model.new_bool_var("")
            for job in range(network.n)
            if not network.before[job].any()
        }
        self._places = [self.model.new_int_var(*network.ranks(job), "") for job in range(network.n)]
        self._constrain()
        if most_skills is not None:
            self._limit(most_skills)
        self.model.minimize(
            cp_model.LinearExpr.weighted_sum(
                list(self._taken.values()), [network.arcs[arc] for arc in self._taken]
            )
        )

    def suggest(self, order: Sequence[int]) -> None:
        """Set the order to start with; once only.

        Hints for arcs only: positions follow, and hints for them slow the search down.
        """
        steps = set(zip((START, *order), order, strict=False))
        for arc, taken in self._taken.items():
            self.model.add_hint(taken, arc in steps)
        for job, last in self._last.items():
            self.model.add_hint(last, job == order[-1])

    def order(self, value: Callable[[cp_model.IntVar], int]) -> tuple[int, ...]:
        """Return the order of a solution."""
        places = [value(place) for place in self._places]
        return tuple(sorted(range(self.network.n), key=places.__getitem__))

    def _constrain(self) -> None:
        # The depot is node 0, job j is node j + 1.
        arcs = [(i + 1, j + 1, taken) for (i, j), taken in self._taken.items()]
        self.model.add_circuit([*arcs, *((i + 1, 0, last) for i, last in self._last.items())])
        for (i, j), taken in self._taken.items():
            here = self._places[j]
            if i == START:
                self.model.add(here == 0).only_enforce_if(taken)
            else:
                self.model.add(here == self._places[i] + 1).only_enforce_if(taken)
        for job, last in self._last.items():
            self.model.add(self._places[job] == self.network.n - 1).only_enforce_if(last)
        for i, j in self.network.neighbours():
            self.model.add(self._places[j] >= self._places[i] + 1)

    def _limit(self, most_skills: int) -> None:
        problem = self.network.problem
        lengths = [
            len(problem.paths.get(arc, ())) + len(problem.skills[arc[1]]) for arc in self._taken
        ]
        total = cp_model.LinearExpr.weighted_sum(list(self._taken.values()), lengths)
        self.model.add(total <= most_skills)
