"""What must be done before and after each job, from preconditions and back ends' verdicts.

Nothing comes between the skills of a job, so that while it is done every other component is either
done or not. A verdict names the facts it rests on: it holds for every set of done components that
agrees on those. So a few queries prove that a skill is feasible for exactly those sets that an
order leaves open. Where they prove anything else, the model is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_query import CheckSteps, Undecided
from skillplan.model.done_jobs import DoneSets
from skillplan.model.fact_analysis import each_bit
from skillplan.task.verdict import Verdict, VerdictStatus

# The most states that are considered for one job before the model is given up.
_MOST_QUERIES = 5_000


class JobQuery:
    """The queries to back ends about the skills of one job.

    Parameters
    ----------
    sets
        The states that are considered.
    job
        Index of the job.
    situation
        Bits of a situation in which it can be begun.

    Attributes
    ----------
    before, after
        Jobs that must be done, and must not, while this one is done; grows.
    """

    def __init__(self, sets: DoneSets, job: int, situation: int) -> None:
        self._sets = sets
        self._structure = sets.structure
        self.job = self._structure.jobs[job]
        self._index = job
        self._queries = 0
        self._found: dict[int, tuple[int, int]] = {}
        self._begins = list(self._beginnings(situation))
        self.before, self.after = sets.demands(job)

    def feasible_sets(self) -> CheckSteps[bool]:
        """Find jobs with which done each skill is feasible, and those of them that are necessary.

        Raises
        ------
        NotASequencing
            If a skill is feasible in no order, or depends on more than on what is done.
        """
        for position in range(len(self.job.chain)):
            yield from self._settle(position)
        return True

    def relations(self) -> CheckSteps[bool]:
        """Find the other jobs that must be done before this one, and those that must not.

        Raises
        ------
        NotASequencing
            If a skill is feasible in no order, or depends on more than on what is done.
        """
        positions = range(len(self.job.chain))
        for position in positions:
            yield from self._settle(position)
            yield from self._necessary(position)
        # What one skill needs, another may have been feasible without.
        for position in positions:
            yield from self._settle(position)
        return True

    def beyond(
        self, closed_before: Mapping[int, int], closed_after: Mapping[int, int]
    ) -> CheckSteps[bool]:
        """Demand that the skills are feasible in every order that respects the relation.

        Parameters
        ----------
        closed_before, closed_after
            By job the jobs that must come before it, and those that are not done before it.

        Raises
        ------
        NotASequencing
            If there is an order in which one is not feasible.
        """
        for position, (done, named) in self._found.items():
            # A verdict that rests on nothing else holds in all of them.
            if named & (done & ~self.before | ~done & ~self.after):
                base = closed_before[self._index]
                never = closed_after[self._index] | 1 << self._index
                yield from self._cover(position, base, never, closed_before)
        return True

    def _beginnings(self, situation: int) -> Iterator[int]:
        """Yield the situation in which each skill is begun."""
        for skill in self.job.chain:
            yield situation
            outcome = skill.prediction
            kept = situation & ~outcome.delete.bits
            situation = kept | outcome.add.bits & self._structure.situation

    def _check(self, position: int, done: int) -> CheckSteps[Verdict]:
        """Return the verdict on a skill of the job where exactly these others are done."""
        self._queries += 1
        skill, structure = self.job.chain[position], self._structure
        if self._queries > _MOST_QUERIES:
            raise Undecided
        own = self._sets.state_bits(done) & ~self.job.own | self.job.stages[position]
        state = structure.task.facts.state(own | self._begins[position])
        verdict = yield skill, state
        if verdict.status is VerdictStatus.UNKNOWN:
            raise Undecided
        assert verdict.present is not None
        assert verdict.absent is not None
        holds, lacks = structure.settled(self._index, position)
        open_bits = verdict.present.bits & ~holds | verdict.absent.bits & ~lacks
        if open_bits & structure.situation:
            fact = structure.task.facts.names_of(open_bits & structure.situation)[0]
            literal = fact if fact in verdict.present else f"not {fact}"
            kind = HypotheticalStates(structure.task).dependence(fact)
            raise structure.no(f"{skill.name} depends on {kind}: {literal}")
        return verdict

    def _blamed(self, verdict: Verdict) -> int:
        return self._sets.named(verdict) & ~(1 << self._index)

    def _settle(self, position: int) -> CheckSteps[None]:
        """Find jobs with which done a skill is feasible that agree with what is known by now."""
        if position in self._found:
            done, named = self._found[position]
            settled = (done | self.before) & ~self.after
            if not named & (done ^ settled):
                self._found[position] = settled, named
                return
        found = yield from self._feasible(position, self.before, self.after, sure=True)
        if found is None:
            verdict = yield from self._check(position, self.before)
            no_order = "in no order" if self.before | self.after else "never"
            why = f"{verdict.stage}: {verdict.reason}"
            name = self.job.chain[position].name
            raise self._structure.no(f"{name} is {no_order} feasible ({why})")
        self._found[position] = found

    def _feasible(
        self, position: int, done: int, undone: int, *, sure: bool = False
    ) -> CheckSteps[tuple[int, int] | None]:
        """Return jobs with which done a skill is feasible, and those its verdict names, or None.

        An infeasible verdict rules out every set that agrees with what it names, so that any
        feasible one differs in that: depth-first search over which.

        Parameters
        ----------
        position
            Which skill.
        done, undone
            Jobs that must, and must not, be done.
        sure
            Whether these are certain to be so: then what alone is left to differ must, too.
        """
        while True:
            verdict = yield from self._check(position, done)
            blamed = self._blamed(verdict)
            if verdict.is_feasible:
                return done, blamed
            blamed &= ~(done | undone)
            if not blamed:
                return None
            if blamed & (blamed - 1):
                break
            done |= blamed
            if sure:
                self.before = done
        for other in each_bit(blamed):
            found = yield from self._feasible(position, done | other, undone)
            if found is not None:
                return found
            undone |= other
        return None

    def _necessary(self, position: int) -> CheckSteps[None]:
        """Find which of the jobs that a feasible verdict names have to be as they are.

        No others can have to be: the verdict holds whatever they are.
        """
        done, named = self._found[position]
        blamed: dict[int, int] = {}
        for other in each_bit(named & ~(self.before | self.after)):
            verdict = yield from self._check(position, done ^ other)
            if not verdict.is_feasible:
                blamed[other] = self._blamed(verdict) & ~other
        while blamed:
            # What rests on nothing but what has to be as it is needs no search.
            sure = [o for o, rest in blamed.items() if not rest & ~(self.before | self.after)]
            for other in sure or [next(iter(blamed))]:
                del blamed[other]
                exception = (0, other) if other & done else (other, 0)
                found = None
                if not sure:
                    found = yield from self._feasible(
                        position, self.before | exception[0], self.after | exception[1]
                    )
                if found is None:
                    self.before |= other & done
                    self.after |= other & ~done

    def _cover(
        self, position: int, done: int, never: int, closed_before: Mapping[int, int]
    ) -> CheckSteps[None]:
        """Demand that a skill is feasible with these done, and whatever else but some jobs."""
        verdict = yield from self._check(position, done)
        if not verdict.is_feasible:
            facts = ", ".join(verdict.facts)
            name = self.job.chain[position].name
            raise self._structure.no(f"{name} depends on more than the order of parts: {facts}")
        for other in each_bit(self._blamed(verdict) & ~(done | never)):
            more = done | other | closed_before[other.bit_length() - 1]
            if not more & never:
                yield from self._cover(position, more, never, closed_before)
            never |= other
