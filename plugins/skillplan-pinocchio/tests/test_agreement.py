"""How far the detectors agree: over everything that can be put in place, in any order.

For every set of elements that can have been put in place, and every other element: may it come
next? Where the hand-made chart says no and geometry says yes, the way on has to be a dead end.
"""

import random
import sys
from itertools import combinations

import pytest

from situations import assembly, config_content
from skillplan.chart import derive_chart
from skillplan.checks import Feasibility
from skillplan.collision import AabbDetector, PrecedenceDetector
from skillplan.pipeline import registry
from skillplan_pinocchio import SweptDetector

NOTHING = frozenset()

# Where geometry lets something follow that the hand-made chart does not: the brace on its own
# posts before the transformer, which can then no longer go under it.
EARLY_BRACES = {
    (frozenset({"pcb", *others}), "brace")
    for count in range(4)
    for others in combinations(("switch_1", "switch_2", "clock"), count)
}


class Order:
    """What back ends say of elements and orders of a task."""

    def __init__(self, task, *back_ends):
        self.task = task
        self.feasibility = Feasibility(task, back_ends)
        self._known = {}

    def may_follow(self, done, element):
        """Return the first verdict on the skills of an element that is not feasible, or None."""
        if (done, element) not in self._known:
            verdicts = (
                self.feasibility.verdict(skill, state_of(self.task, done, skill))
                for skill in skills_of(self.task, element)
            )
            self._known[done, element] = next((v for v in verdicts if not v.is_feasible), None)
        return self._known[done, element]

    def allows(self, done, element):
        """Whether an element may come next."""
        return self.may_follow(done, element) is None

    def reachable(self):
        """Return every set of elements that can have been put in place."""
        results, queue = {NOTHING}, [NOTHING]
        for done in queue:
            for element in self.task.operations:
                after = done | {element}
                if element not in done and after not in results and self.allows(done, element):
                    results.add(after)
                    queue.append(after)
        return results

    def pairs(self):
        """Return every reachable set with every element that it lacks."""
        return {
            (done, element)
            for done in self.reachable()
            for element in self.task.operations
            if element not in done
        }

    def leads_on(self):
        """Return the reachable sets from which everything can still be put in place."""
        everything = frozenset(self.task.operations)
        good = {everything} & self.reachable()
        for done in sorted(self.reachable(), key=len, reverse=True):
            if any(
                done | {element} in good and self.allows(done, element)
                for element in everything - done
            ):
                good.add(done)
        return good


def skills_of(task, element):
    """Return the skills that put an element in place, in order."""
    own = [skill for skill in task.skills if element in skill.parameters.values()]
    return [
        skill
        for kind in ("pick", "place", "fasten")
        for skill in own
        if skill.name == f"{kind}({element})"
    ]


def state_of(task, done, skill):
    """Return the state in which these elements are in place and a skill is applicable."""
    facts = {"at(home)", *skill.precondition.requires}
    for element, fact in task.operations.items():
        if element in done:
            facts.add(fact)
        elif fact.startswith("placed(") and f"held({element})" not in facts:
            facts.add(f"at_start({element})")
    state = task.facts.of(*facts)
    assert skill.applicable(state)
    return state


def assert_more_is_allowed_in_dead_ends_only(geometry, chart):
    """Assert that geometry differs from the board's chart by early braces, and is right to."""
    pairs = chart.pairs()
    assert {pair for pair in pairs if chart.allows(*pair) != geometry.allows(*pair)} == EARLY_BRACES
    assert all(geometry.allows(*pair) for pair in EARLY_BRACES)
    good = geometry.leads_on()
    assert not any(done | {element} in good for done, element in EARLY_BRACES)


@pytest.fixture(scope="module")
def swept(board):
    """Return what the detector under test says."""
    return Order(board, SweptDetector(board))


def test_it_agrees_with_boxes_on_every_pair(board, swept):
    """Fingers, hand and arm add nothing on this board: it was laid out with room for them."""
    boxes = Order(board, AabbDetector(board))
    assert swept.reachable() == boxes.reachable()
    differing = {pair for pair in swept.pairs() if swept.allows(*pair) != boxes.allows(*pair)}
    assert differing == set()


def test_it_agrees_with_the_chart_but_for_dead_ends(board, swept):
    """Over all 25 sets of parts; of 66 pairs 8 differ, and each shuts the transformer out."""
    chart = Order(board, PrecedenceDetector(board))
    pairs = chart.pairs()
    parts = {
        (done, element)
        for done, element in pairs
        if not any("screw" in item for item in (*done, element))
    }
    assert len({done for done, _ in pairs if not any("screw" in part for part in done)}) == 25
    assert len(parts) == 66
    assert_more_is_allowed_in_dead_ends_only(swept, chart)
    assert NOTHING in swept.leads_on()


@pytest.mark.parametrize("product", ["inverter_board", "sensor_stack"])
def test_the_derived_chart_is_the_hand_made_one(product, product_task):
    """Nothing missing, nothing extra, nothing left open; of products of different orders."""
    task = product_task(product)
    chart = derive_chart(Feasibility(task, [SweptDetector(task)]))
    assert chart.hand_made
    assert chart.missing == ()
    assert chart.extra == ()
    assert chart.impossible == {}
    assert chart.conditional == {}
    assert chart.undecided == ()


def test_a_tall_part_next_to_a_finger_changes_the_chart():
    """The clock as a tower beside a switch: the switch has to come before it."""
    content = config_content("inverter_board")
    content["parts"]["clock"] |= {"goal_m": [0.476, 0.040], "size_m": [0.020, 0.020, 0.060]}
    task = assembly(content)
    chart = derive_chart(Feasibility(task, [SweptDetector(task)]))
    assert chart.missing == ()
    (relation,) = chart.extra
    assert (relation.before, relation.after) == ("switch_2", "clock")
    assert relation.reason.startswith("a finger runs into clock on the ")


def test_a_part_taken_away_takes_its_relations_along():
    """Without the transformer the brace may come any time after the board."""
    content = config_content("inverter_board")
    del content["parts"]["transformer"]
    for key in ("actions", "observation", "expect", "chart"):
        del content[key]
    content["collision"] = {"swept": {}}
    task = assembly(content)
    chart = derive_chart(Feasibility(task, [SweptDetector(task)]))
    pairs = {(relation.before, relation.after) for relation in chart.relations}
    assert ("pcb", "brace") in pairs
    assert not any(after == "brace" and before != "pcb" for before, after in pairs)


def test_every_pair_of_parts_says_why_not(board, swept):
    """A reason, and the bodies it blames."""
    for first, second in combinations(("switch_1", "clock", "transformer"), 2):
        verdict = swept.may_follow(NOTHING, second)
        assert verdict.reason == f"{second} has nothing beneath it"
        assert first not in verdict.evidence["possible_supports"]
        assert verdict.evidence["possible_supports"] == ["pcb"]
    verdict = swept.may_follow(frozenset({"pcb", "brace"}), "transformer")
    assert verdict.reason == "transformer runs into brace on the approach"
    verdict = swept.may_follow(frozenset({"pcb", "transformer"}), "screw_1")
    assert verdict.reason == "screw_1 has nothing beneath it"


def executed_order(task):
    """Return what simulated execution in pybullet says."""
    if sys.version_info >= (3, 12):
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")
    engine = registry.load("physics", "pybullet")(task)
    contacts = registry.load("collision", "contact-pairs")(task)
    return Order(task, engine, contacts)


@pytest.mark.slow(
    reason="executes four pairs of the board; every run compares the same two on a smaller task"
)
def test_it_agrees_with_simulated_execution_on_a_sample_of_pairs(board, swept):
    """As many that may follow as may not."""
    executed = executed_order(board)
    pairs = sorted(swept.pairs(), key=lambda pair: (sorted(pair[0]), pair[1]))
    allowed = [pair for pair in pairs if swept.allows(*pair)]
    barred = [pair for pair in pairs if not swept.allows(*pair)]
    chance = random.Random(3)
    assert all(executed.allows(*pair) for pair in chance.sample(allowed, 2))
    assert not any(executed.allows(*pair) for pair in chance.sample(barred, 2))


@pytest.mark.release(reason="every pair executed; a sample of them in the whole suite")
@pytest.mark.parametrize("product", ["inverter_board", "sensor_stack"])
def test_it_agrees_with_simulated_execution_on_every_pair(product, product_task):
    """Every reachable set with every part and screw that it lacks, executed in pybullet."""
    task = product_task(product)
    swept, executed = Order(task, SweptDetector(task)), executed_order(task)
    differing = {
        (tuple(sorted(done)), element): executed.may_follow(done, element)
        for done, element in swept.pairs()
        if swept.allows(done, element) != executed.allows(done, element)
    }
    assert len(swept.pairs()) > 200
    assert differing == {}
    if product == "inverter_board":
        chart = Order(task, PrecedenceDetector(task))
        assert_more_is_allowed_in_dead_ends_only(executed, chart)
