"""What the parts of a chain come to as a whole: status, cost, bound and effort."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from skillplan.domains import Account, Listing
from skillplan.pipeline import SearchRequest, describe, grade, search, solve
from skillplan.records import ChainPart, ChainResult, Result, Status
from skillplan.task import Task
from skillplan.views import render, render_csv
from skillplan.views.tables import (
    tabulate_appendix,
    tabulate_chain,
    tabulate_chain_comparison,
    tabulate_listing,
)
from swarm_situations import base_task

TWO, ONE = base_task(66, 42), base_task(42, 29)


@cache
def _proved(way: int) -> Result:
    return solve((TWO, ONE)[way])


def proved(task: Task) -> Result:
    """Return the optimum of a task; those of the two ways are searched once."""
    for index, way in enumerate((TWO, ONE)):
        if task is way:
            return _proved(index)
    return solve(task)


def result(task: Task, status: Status = Status.OPTIMAL, **changes: Any) -> Result:
    """Return a row of a way, as the referee might have granted it."""
    best = proved(task)
    if status in (Status.OPTIMAL, Status.SOLVED):
        figures: dict[str, Any] = {
            "cost": best.cost,
            "steps": best.steps,
            "makespan_s": best.makespan_s,
            "lower_bound": best.cost,
        }
    else:
        figures = {"reason": "told"}
    ungraded = describe(SearchRequest(task, "made"))
    return replace(replace(ungraded, status=status, **figures), **changes)


def part(
    task: Task, status: Status = Status.OPTIMAL, *, reused: bool = False, **more: Any
) -> ChainPart:
    optimum = more.pop("optimum", proved(task).cost)
    return ChainPart(task, result(task, status, **more), optimum, reused)


def chain(
    *parts: ChainPart, expected: int | None = None, account: Account = Account()
) -> ChainResult:
    count = len(parts) if expected is None else expected
    return ChainResult("job", "swarmitfix", "0" * 64, "made", 0, parts, count, account)


class TestChecks:
    def test_a_chain_has_a_part(self):
        with pytest.raises(ValueError, match="0 parts of 2 are not a chain"):
            chain(expected=2)

    def test_a_chain_has_no_more_parts_than_expected(self):
        with pytest.raises(ValueError, match="2 parts of 1 are not a chain"):
            chain(part(TWO), part(ONE), expected=1)

    def test_a_listing_has_as_many_cells_as_columns(self):
        with pytest.raises(ValueError, match="does not have 2 cells"):
            Listing("title", ("a", "b"), (("1", "2"), ("3",)))


class TestStatus:
    def test_optimal_parts_without_a_gap_are_optimal(self):
        whole = chain(part(TWO), part(ONE))
        assert (Status.OPTIMAL, 3.0, 3.0, 0.0, "") == (
            whole.status,
            whole.cost,
            whole.lower_bound,
            whole.gap,
            whole.reason,
        )

    @pytest.mark.parametrize(
        ("worst", "others"),
        [
            (Status.WRONG, [Status.REFUSED, Status.INFEASIBLE, Status.UNSOLVED, Status.OPTIMAL]),
            (Status.REFUSED, [Status.INFEASIBLE, Status.UNSOLVED, Status.SOLVED]),
            (Status.INFEASIBLE, [Status.UNSOLVED, Status.OPTIMAL]),
            (Status.UNSOLVED, [Status.SOLVED, Status.OPTIMAL]),
        ],
    )
    def test_the_weakest_part_decides(self, worst, others):
        """In whatever order they come."""
        parts = [part(TWO, status) for status in (*others, worst)]
        assert worst is chain(*parts).status
        assert worst is chain(*reversed(parts)).status
        assert None is chain(*parts).cost

    def test_a_chain_that_lacks_parts_is_unsolved(self):
        whole = chain(part(TWO), expected=2)
        assert (Status.UNSOLVED, None, None, None, None) == (
            whole.status,
            whole.cost,
            whole.lower_bound,
            whole.makespan,
            whole.makespan_s,
        )

    def test_an_unproved_way_without_a_gap_is_optimal_all_the_same(self):
        """Exact search beside it has proved its cost."""
        learned = part(TWO, Status.SOLVED, optimum=2.0)
        assert Status.OPTIMAL is chain(learned).status

    def test_a_way_longer_than_its_optimum_leaves_a_gap(self):
        longer = part(TWO, Status.SOLVED, cost=4.0, lower_bound=2.0)
        whole = chain(longer, part(ONE))
        assert (Status.SOLVED, 5.0, 3.0) == (whole.status, whole.cost, whole.lower_bound)
        assert whole.gap == pytest.approx(0.4)

    def test_without_an_optimum_nothing_is_proved(self):
        whole = chain(part(TWO, Status.SOLVED, optimum=None, lower_bound=None))
        assert (Status.SOLVED, None, None) == (whole.status, whole.lower_bound, whole.gap)

    def test_the_domain_s_bound_is_over_all_choices_of_the_upper_levels(self):
        """Optimal ways to goals that are not the best ones are not the optimum."""
        whole = chain(part(TWO), part(ONE), account=Account(lower_bound=2.0))
        assert (Status.SOLVED, 2.0) == (whole.status, whole.lower_bound)
        assert "the account of the whole job" == whole.document()["bound_method"]

    def test_an_upper_level_that_is_not_optimal_takes_the_proof_away(self):
        """Even where the last level's sum meets a bound over all choices."""
        upper, bound = TWO.replace(stage="goals"), Account(lower_bound=1.0)
        costlier = part(upper, Status.SOLVED, cost=4.0, optimum=2.0, lower_bound=2.0)
        assert Status.SOLVED is chain(costlier, part(ONE), account=bound).status
        assert not chain(costlier, part(ONE), account=bound).proved_by_level
        assert Status.OPTIMAL is chain(part(upper), part(ONE), account=bound).status

    def test_stages_that_are_the_best_one_by_one_need_not_be_the_best_together(self):
        """Other heads of the same number may leave shorter ways: solved, with the reason."""
        whole = chain(part(TWO.replace(stage="heads")), part(ONE))
        assert (Status.SOLVED, None, None) == (whole.status, whole.lower_bound, whole.gap)
        assert (True, 1.0) == (whole.proved_by_level, whole.bound_given)
        assert "every stage is the best, proved, given the ones before" == whole.reason

    def test_the_bound_given_the_stages_before_may_be_the_domain_s(self):
        """Its rule for goals was not the best for these heads."""
        heads = part(TWO.replace(stage="heads"))
        whole = chain(heads, part(TWO), account=Account(bound_given=1.0))
        assert (1.0, False, "") == (whole.bound_given, whole.proved_by_level, whole.reason)
        document = whole.document()
        assert (1.0, False) == (document["bound_given_stages_before"], document["proved_by_level"])

    def test_ways_of_no_step_have_no_gap(self):
        whole = chain(part(base_task(42, 42)))
        assert (Status.OPTIMAL, 0.0, 0.0, 0) == (
            whole.status,
            whole.cost,
            whole.gap,
            whole.makespan,
        )

    def test_the_reason_names_the_part(self):
        whole = chain(part(TWO), part(ONE, Status.UNSOLVED))
        assert "C42-C29: told" == whole.reason
        assert "interrupted" == chain(part(TWO, interrupted=True), expected=2).reason


class TestFigures:
    def test_only_the_last_stage_adds_up(self):
        """Supports, goals and steps are not of one unit."""
        whole = chain(part(TWO.replace(stage="heads")), part(ONE))
        assert (1.0, 1, "base") == (whole.cost, whole.makespan, whole.stage)
        document = whole.document()
        assert (["C42-C29"], ["C66-C42"]) == (
            [entry["name"] for entry in document["sequences"]],
            [entry["name"] for entry in document["stages"]],
        )

    def test_equal_parts_are_all_there(self):
        """The same way twice is two sequences."""
        assert 2 == len(chain(part(ONE), part(ONE)).document()["sequences"])

    def test_reused_policies_take_no_time_twice(self):
        parts = part(TWO, wall_s=1.0, expanded=7), part(ONE, wall_s=1.0, expanded=7, reused=True)
        assert (1.0, 7) == (chain(*parts).wall_s, chain(*parts).iterations)

    def test_the_domain_may_know_the_time_of_the_whole(self):
        """Swings are not all; without it the parts' times add up."""
        assert 99.0 == chain(part(TWO), account=Account(makespan_s=99.0)).makespan_s
        assert chain(part(TWO), part(ONE)).makespan_s == pytest.approx(2 * 11.63 + 7.47)

    def test_a_part_says_where_it_leads(self):
        item = part(TWO)
        assert (["C66", "C54", "C42"], ("C66", "C42")) == (item.path, item.ends)
        assert [] == part(TWO, Status.UNSOLVED).path

    def test_the_document_is_json_with_everything(self):
        """The keys of a result, the sequences with start, goal and path, and the domain's own."""
        whole = chain(part(TWO), part(ONE), account=Account({"bench": {"rows": 6}}))
        document = json.loads(json.dumps(whole.document(), allow_nan=False))
        assert ("skillplan.result/1", {"rows": 6}) == (document["schema"], document["bench"])
        assert [("C66", "C42", 2.0), ("C42", "C29", 1.0)] == [
            (entry["start"], entry["goal"], entry["optimum"]) for entry in document["sequences"]
        ]
        assert ["B2", "B2", "B1"] == document["skills"]
        assert [0, 1, 2] == [step["index"] for step in document["steps"]]
        assert [2, 2, 1] == document["actions"]


class TestTables:
    def text(self, *parts: ChainPart, **more: Any) -> str:
        return render(tabulate_chain(chain(*parts, **more)), "md", io.StringIO())

    def test_a_row_says_the_way_with_its_skills(self):
        message = self.text(part(TWO), part(ONE, reused=True))
        assert "C66 B2 C54 B2 C42" in message
        assert "made, stored" in message
        assert "1 tasks answered by a policy" in message or "1 task answered by a policy" in message

    def test_an_unsolved_chain_says_why(self):
        message = self.text(part(TWO), part(ONE, Status.UNSOLVED), expected=3)
        assert "C42-C29: told" in message

    def test_the_domain_s_listings_come_first(self):
        listing = Listing("supports", ("goal", "by"), (("1", "eq34"),), ("a note",))
        tables = tabulate_chain(chain(part(TWO), account=Account(listings=(listing,))))
        assert ["supports", "job"] == [tables[0].title, tables[1].title.partition(":")[0]]
        assert (True, False) == tuple(column.right for column in tables[0].columns)

    def test_the_appendix_is_saved_by_name(self):
        account = Account(appendix={"timeline.csv": Listing("steps", ("s",), (("1",),))})
        (name,) = tabulate_appendix(chain(part(TWO), account=account))
        assert "timeline.csv" == name
        assert "s\n1\n" == render_csv(tabulate_listing(account.appendix[name])).replace("\r", "")

    def test_solvers_stand_side_by_side_sequence_by_sequence(self):
        """As in the paper's Table 3; a solver that failed is not there."""
        good = chain(part(TWO), part(ONE))
        bad = chain(part(TWO, Status.UNSOLVED), expected=2)
        summary, beside = tabulate_chain_comparison([good, bad], "title")
        assert ["optimal", "unsolved"] == [row[1] for row in summary.rows]
        assert [("C66", "C42", "2"), ("C42", "C29", "1")] == [tuple(r[1:4]) for r in beside.rows]
        (only,) = tabulate_chain_comparison([bad], "title")
        assert ("made: C66-C42: told",) == tuple(only.notes)

    def test_a_graded_attempt_makes_a_part(self):
        """End to end, without anything made up."""
        request = SearchRequest(TWO, "exact")
        graded = grade(request, search(request))
        assert Status.OPTIMAL is chain(ChainPart(TWO, graded, graded.cost)).status
