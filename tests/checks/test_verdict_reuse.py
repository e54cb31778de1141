"""Invariant: a reused verdict equals a fresh one, in any state, reachable or not."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import (
    assembly,
    config_content,
    crowded_assemblies,
    fake_back_end,
    imagined_state,
    small_assemblies,
)
from skillplan.checks import Checked, Feasibility, VerdictCache
from skillplan.collision import AabbDetector, PrecedenceDetector
from skillplan.physics import KinematicEngine
from skillplan.task import Verdict
from thinned import slow_case

seeds = st.integers(0, 2**32)
BOARD = assembly(config_content("inverter_board"))


def aabb(**options):
    return lambda task: AabbDetector(task, AabbDetector.Options(**options))


def precedence(**options):
    return lambda task: PrecedenceDetector(task, PrecedenceDetector.Options(**options))


BACK_ENDS = {
    "kinematic": KinematicEngine,
    "aabb": aabb(),
    "aabb without supports": aabb(check_support=False),
    "aabb with tolerance": aabb(tolerance_m=0.004),
    "precedence": precedence(),
    "precedence holding back picks": precedence(hold_back_picks=True),
}


def assert_reuse(task, make, rng, pairs):
    """Assert that a verdict equals a fresh one wherever it applies; return how many did.

    The second state of a pair shares the facts of the first one's verdict and is random else.
    """
    queries, reused = make(task), 0
    for skill in task.skills:
        for _ in range(pairs):
            state = imagined_state(task, skill, rng)
            if state is None:
                continue
            verdict = queries.check(skill, state).grounded(state, queries.name)
            assert verdict.applies_in(state)
            other = imagined_state(task, skill, rng, verdict.present, verdict.absent)
            if other is None or not verdict.applies_in(other):
                continue
            fresh = make(task).check(skill, other).grounded(other, queries.name)
            assert verdict == fresh
            reused += other != state
    return reused


@pytest.mark.parametrize(
    "back_end",
    [
        slow_case(name, reason="three back ends in every run") if " " in name else name
        for name in BACK_ENDS
    ],
)
@settings(max_examples=examples(100))
@given(content=crowded_assemblies(), seed=seeds)
def test_a_reused_verdict_equals_a_fresh_one_in_crowded_assemblies(back_end, content, seed):
    """Tall, turned and stacked parts, feeders, envelopes, swaps and separate tool changes."""
    assert_reuse(assembly(content), BACK_ENDS[back_end], random.Random(seed), pairs=5)


@pytest.mark.parametrize("back_end", BACK_ENDS)
@pytest.mark.parametrize(
    "config",
    ["inverter_board", slow_case("motor_drive", reason="twelve parts; a board in every run")],
)
def test_a_reused_verdict_equals_a_fresh_one_on_the_configs(back_end, config):
    """Most pairs of states differ, so that reuse is put to the test."""
    task = assembly(config_content(config))
    reused = assert_reuse(task, BACK_ENDS[back_end], random.Random(1), pairs=8)
    assert reused > 4 * len(task.skills)


@settings(max_examples=examples(60))
@given(content=crowded_assemblies(), seed=seeds)
def test_a_chain_that_remembers_rules_like_one_that_does_not(content, seed):
    """The whole of it: several back ends, one cache, many random states in turn."""
    task, rng = assembly(content), random.Random(seed)
    makers = list(BACK_ENDS.values())
    makers = [makers[0], makers[1], makers[4]]
    warm = Feasibility(task, [make(task) for make in makers])
    for skill in task.skills:
        for _ in range(10):
            state = imagined_state(task, skill, rng)
            if state is not None:
                cold = Feasibility(task, [make(task) for make in makers])
                assert warm.verdict(skill, state) == cold.verdict(skill, state)


@settings(max_examples=examples(30))
@given(content=small_assemblies(), seed=seeds)
def test_what_cannot_say_is_reused_in_the_same_state_only(content, seed):
    """A verdict without facts never serves another state."""
    task, rng = assembly(content), random.Random(seed)
    back_end = fake_back_end(task, Verdict.feasible())
    feasibility = Feasibility(task, [back_end])
    seen = set()
    for skill in task.skills:
        for _ in range(4):
            state = imagined_state(task, skill, rng)
            if state is None:
                continue
            for _ in range(2):
                verdict = feasibility.verdict(skill, state)
                assert verdict.present == state
                assert verdict.absent == state.complement()
            seen.add((skill.name, state))
            assert len(back_end.asked) == len(seen)


@given(st.lists(st.tuples(st.integers(0, 63), st.integers(0, 63)), max_size=12), seeds)
def test_the_cache_finds_what_a_scan_of_all_kept_verdicts_finds(entries, seed):
    """However the verdicts' facts overlap."""
    task = BOARD
    facts, skill = task.facts, task.skills[0]
    back_end, cache = fake_back_end(task), VerdictCache()
    kept = []
    for i, (present, absent) in enumerate(entries):
        sets = facts.state(present), facts.state(absent & ~present)
        # Verdicts of one back end agree where both apply: here on which facts they rest.
        if any(not (v.present & sets[1]).bits and not (v.absent & sets[0]).bits for v in kept):
            continue
        kept.append(Verdict.infeasible(f"reason {i}", *sets))
        cache.keep(back_end, skill, Checked(kept[-1], 0.0), sets[0])
    rng = random.Random(seed)
    for _ in range(20):
        state = facts.state(rng.randrange(64))
        expected = next((verdict for verdict in kept if verdict.applies_in(state)), None)
        assert expected == cache.find(back_end, skill, state)
        assert cache.find(back_end, task.skills[1], state) is None
