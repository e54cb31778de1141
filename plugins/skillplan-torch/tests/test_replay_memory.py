"""What is remembered, held against a memory in plain Python that is slow and obvious."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan_torch.dqn.replay_memory import ReplayMemory

TRANSITIONS = st.tuples(
    st.integers(0, 2),  # observation
    st.integers(0, 1),  # action
    st.integers(0, 2),  # next_observation
    st.sampled_from([0, 0, 1]),  # end
    st.sampled_from([-1.0, -0.5, -0.25]),  # reward
    st.integers(1, 3),  # steps
)
# What happens to a run: something is added, or the last few are completed.
HAPPENINGS = st.lists(st.tuples(st.integers(0, 1), TRANSITIONS, st.booleans()), max_size=60)


class Uniforms:
    """A generator that gives what it was told."""

    def __init__(self, values):
        self._values = np.array(values)

    def random(self, count):
        assert count == len(self._values)
        return self._values


class PlainMemory:
    """One run's transitions in a list, the oldest first."""

    def __init__(self, capacity, distinct):
        self.capacity, self.distinct, self.kept = capacity, distinct, []

    def add(self, observation, action, following, end, reward, steps):
        key = (observation, action, following, end)
        same = [one for one in self.kept if self.distinct and one["key"] == key]
        if same:
            (one,) = same
        else:
            if len(self.kept) == self.capacity:
                self.kept.pop(0)
            one = {"key": key, "seen": 0, "best": math.nan}
            self.kept.append(one)
        one["seen"] += 1
        one["reward"], one["steps"] = reward, steps
        return one

    def tried(self, one):
        return sum(other["seen"] for other in self.kept if other["key"][:2] == one["key"][:2])


def remembered(memory, run):
    """Return all that a run remembers, in no order."""
    names = ("observation", "action", "next_observation", "end", "reward", "steps", "seen", "best")
    return sorted(
        repr(tuple(float(getattr(memory, name)[run, slot]) for name in names))
        for slot in range(memory.size(run))
    )


def expected(plain):
    return sorted(
        repr(
            tuple(map(float, (*one["key"], one["reward"], one["steps"], one["seen"], one["best"])))
        )
        for one in plain.kept
    )


def rebuilt(memory, runs, capacity, **more):
    other = ReplayMemory(runs, capacity, **more)
    other.read("m", memory.arrays("m"))
    return other


class TestWhatIsRemembered:
    @settings(max_examples=examples(150))
    @given(HAPPENINGS, st.integers(1, 12), st.booleans(), st.integers(0, 60))
    def test_it_is_what_a_list_would_hold(self, happenings, capacity, distinct, cut):
        more = {"distinct": distinct, "priority": 0.0}
        memory = ReplayMemory(2, capacity, **more)
        plain = [PlainMemory(capacity, distinct) for _ in range(2)]
        episodes = ([], [])
        for i, (run, transition, completes) in enumerate(happenings):
            if i == cut:
                memory = rebuilt(memory, 2, capacity, **more)
            observation, action, following, end, reward, steps = transition
            slot = memory.add(run, observation, action, reward, end, following, steps)
            one = plain[run].add(observation, action, following, end, reward, steps)
            episodes[run].append((slot, one, reward))
            if completes:
                # Only what is still there: a slot may be another's by now.
                way = [
                    (place, kept, paid)
                    for place, kept, paid in episodes[run]
                    if any(kept is other for other in plain[run].kept)
                ]
                memory.complete(run, [place for place, _, _ in way], [paid for _, _, paid in way])
                total = 0.0
                for _, kept, paid in reversed(way):
                    total += paid
                    kept["best"] = total if math.isnan(kept["best"]) else max(kept["best"], total)
                episodes[run].clear()
            for which in (0, 1):
                assert memory.size(which) == len(plain[which].kept)
                assert remembered(memory, which) == expected(plain[which])
                if distinct:
                    assert sorted(memory.tried[which, : memory.size(which)].tolist()) == sorted(
                        plain[which].tried(kept) for kept in plain[which].kept
                    )

    @pytest.mark.parametrize("distinct", [False, True])
    def test_there_is_room_for_more_than_at_first(self, distinct):
        memory = ReplayMemory(2, 100_000, distinct=distinct, priority=0.5)
        for i in range(5_000):
            assert memory.add(0, i, i % 7, -float(i), 0, i + 1, 1) == i
        memory.add(1, 4, 2, -1.0, 1, 0, 1)
        again = rebuilt(memory, 2, 100_000, distinct=distinct, priority=0.5)
        for one in (memory, again):
            assert (one.size(0), one.size(1)) == (5_000, 1)
            assert (one.observation[0, :5_000] == np.arange(5_000)).all()
            assert (one.reward[0, :5_000] == -np.arange(5_000.0)).all()
            assert np.isnan(one.best[0, :5_000]).all()
            assert one.add(0, 17, 3, -1.0, 0, 18, 1) == (17 if distinct else 5_000)


class TestWhatIsDrawn:
    def test_without_priorities_every_transition_is_as_likely(self):
        memory = ReplayMemory(2, 10, distinct=False, priority=0.0)
        for i in range(4):
            memory.add(0, i, 0, 0.0, 0, 0, 1)
        memory.add(1, 0, 0, 0.0, 0, 0, 1)
        uniforms = Uniforms([0.0, 0.24, 0.26, 0.5, 0.74, 0.76, 1 - 2**-53])
        slots, weights = memory.draw([uniforms, uniforms], 7)
        assert slots.tolist() == [[0, 0, 1, 2, 2, 3, 3], [0] * 7]
        assert (weights == 1.0).all()

    def test_outcomes_of_a_choice_count_as_often_as_they_were_seen(self):
        memory = ReplayMemory(1, 10, distinct=True, priority=0.0)
        for following in (5, 5, 6, 5):
            memory.add(0, 1, 2, 0.0, 0, following, 1)
        memory.add(0, 1, 3, 0.0, 0, 5, 1)
        slots, weights = memory.draw([Uniforms([0.1, 0.5, 0.9])], 3)
        assert slots.tolist() == [[0, 1, 2]]
        assert weights.tolist() == [[0.75, 0.25, 1.0]]

    def test_what_was_forgotten_no_longer_counts(self):
        memory = ReplayMemory(1, 2, distinct=True, priority=0.0)
        for following in (5, 6, 7):
            memory.add(0, 1, 2, 0.0, 0, following, 1)
        slots, weights = memory.draw([Uniforms([0.1, 0.9])], 2)
        assert memory.next_observation[0, slots[0]].tolist() == [7, 6]
        assert weights.tolist() == [[0.5, 0.5]]

    def test_by_priority_they_are_drawn_in_proportion_and_count_the_less(self):
        memory = ReplayMemory(1, 10, distinct=False, priority=2.0)
        for i in range(3):
            memory.add(0, i, 0, 0.0, 0, 0, 1)
        errors = np.array([[-1.0, 2.0, 3.0]], dtype=np.float32)
        memory.learned(np.array([[0, 1, 2]]), errors)
        shares = (np.abs(errors[0].astype(float)) + 1e-3) ** 2
        totals = np.cumsum(shares) / shares.sum()
        inside = [0.0, totals[0] - 1e-6, totals[0] + 1e-6, totals[1] - 1e-6, totals[1] + 1e-6]
        slots, weights = memory.draw([Uniforms([*inside, 1 - 2**-53])], 6)
        assert slots.tolist() == [[0, 0, 1, 1, 2, 2]]
        np.testing.assert_allclose(weights[0], (shares.mean() / shares)[[0, 0, 1, 1, 2, 2]])

    def test_what_is_new_is_as_likely_as_the_likeliest(self):
        memory = ReplayMemory(1, 10, distinct=True, priority=1.0)
        for i in range(3):
            memory.add(0, i, 0, 0.0, 0, 0, 1)
        memory.learned(np.array([[0, 1, 2]]), np.array([[0.5, 4.0, 0.1]], dtype=np.float32))
        new = memory.add(0, 3, 0, 0.0, 0, 0, 1)
        assert memory.error[0, new] == memory.error[0, :4].max() == 4.0

    def test_nothing_is_never_drawn(self):
        memory = ReplayMemory(1, 10, distinct=False, priority=1.0)
        for i in range(3):
            memory.add(0, i, 0, 0.0, 0, 0, 1)
        memory.learned(np.array([[0, 1, 2]]), np.zeros((1, 3), dtype=np.float32))
        slots, weights = memory.draw([Uniforms([0.1, 0.5, 0.9])], 3)
        assert slots.tolist() == [[0, 1, 2]]
        np.testing.assert_allclose(weights, 1.0)


class TestGoingOn:
    @pytest.mark.parametrize("distinct", [False, True])
    def test_what_was_read_draws_and_forgets_alike(self, distinct):
        more = {"distinct": distinct, "priority": 0.7}
        memory, generator = ReplayMemory(2, 30, **more), np.random.default_rng(0)

        def happens(one, seed):
            chance = np.random.default_rng(seed)
            for _ in range(25):
                run, observation, action, following = chance.integers([2, 6, 2, 6]).tolist()
                one.add(run, observation, action, -float(chance.random()), 0, following, 1)
            one.add(0, 0, 0, 0.0, 0, 0, 1)
            one.add(1, 0, 0, 0.0, 0, 0, 1)
            slots, weights = one.draw([np.random.default_rng([seed, run]) for run in (0, 1)], 16)
            one.learned(slots, chance.standard_normal(slots.shape).astype(np.float32))
            return slots.tobytes() + weights.tobytes()

        happens(memory, generator.integers(99))
        for seed in range(8):
            other = rebuilt(memory, 2, 30, **more)
            assert happens(memory, seed) == happens(other, seed)
            mine, theirs = memory.arrays("m"), other.arrays("m")
            assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine)

    def test_arrays_of_others_are_refused(self):
        memory = ReplayMemory(2, 30, distinct=True, priority=0.0)
        with pytest.raises(ValueError, match="missing or of another shape"):
            ReplayMemory(3, 30, distinct=True, priority=0.0).read("m", memory.arrays("m"))


def test_how_likely_an_outcome_is_is_worked_out_over_all_observations() -> None:
    """Of an action that failed once in four tries here, and once in two there."""
    memory = ReplayMemory(1, 100, distinct=True, priority=0.0)
    # Where it is taken, then whether it succeeded.
    observations = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], dtype=np.float32)
    for before, after, times in ((0, 1, 3), (0, 0, 1), (2, 3, 1), (2, 2, 1)):
        for _ in range(times):
            memory.add(0, before, 7, 0.0, 0, after, 1)
    memory.pool(0, observations)
    likely = dict(zip(memory.next_observation[0, :4].tolist(), memory.share[0, :4], strict=True))
    assert likely == pytest.approx({1: 4 / 6, 0: 2 / 6, 3: 4 / 6, 2: 2 / 6})


def test_of_an_action_with_one_outcome_nothing_is_pooled() -> None:
    memory = ReplayMemory(1, 100, distinct=True, priority=0.0)
    memory.add(0, 0, 7, 0.0, 0, 1, 1)
    memory.pool(0, np.zeros((2, 1), dtype=np.float32))
    assert np.isnan(memory.share[0, 0])
