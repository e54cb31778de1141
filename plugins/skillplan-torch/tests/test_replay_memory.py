"""What is remembered, held against a memory in plain Python that is slow and obvious."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan_torch import ReplayMemory

TRANSITIONS = st.tuples(
    st.integers(0, 2),  # observation
    st.integers(0, 1),  # action
    st.integers(0, 2),  # next_observation
    st.sampled_from([0, 0, 1]),  # end
    st.sampled_from([-1.0, -0.5, -0.25]),  # reward
)
HAPPENINGS = st.lists(st.tuples(st.integers(0, 1), TRANSITIONS), max_size=60)


class Uniforms:
    """A generator that gives what it was told."""

    def __init__(self, values):
        self._values = np.array(values)

    def random(self, count):
        assert count == len(self._values)
        return self._values


class PlainMemory:
    """One run's transitions in a list, the oldest first."""

    def __init__(self, capacity):
        self.capacity, self.kept = capacity, []

    def add(self, observation, action, following, end, reward):
        key = (observation, action, following, end)
        same = [entry for entry in self.kept if entry["key"] == key]
        if same:
            (item,) = same
        else:
            if len(self.kept) == self.capacity:
                self.kept.pop(0)
            item = {"key": key, "seen": 0, "reward": 0.0}
            self.kept.append(item)
        item["seen"] += 1
        # On average.
        item["reward"] = ((item["seen"] - 1) * item["reward"] + reward) / item["seen"]

    def tried(self, first):
        return sum(other["seen"] for other in self.kept if other["key"][:2] == first["key"][:2])


def remembered(memory, run):
    """Return all that a run remembers, in no order."""
    names = ("observation", "action", "next_observation", "end", "reward", "seen")
    return sorted(
        tuple(float(getattr(memory, name)[run, slot]) for name in names)
        for slot in range(memory.size(run))
    )


def expected(plain):
    """Return the same of a plain memory."""
    kept = sorted(
        (*map(float, item["key"]), item["reward"], float(item["seen"])) for item in plain.kept
    )
    return [(*key, pytest.approx(reward), seen) for *key, reward, seen in kept]


def rebuilt(memory, runs, capacity):
    other = ReplayMemory(runs, capacity, distinct=True)
    other.read("m", memory.arrays("m"))
    return other


class TestWhatIsRemembered:
    @settings(max_examples=examples(150))
    @given(HAPPENINGS, st.integers(1, 12), st.integers(0, 60))
    def test_it_is_what_a_list_would_hold(self, happenings, capacity, cut):
        memory = ReplayMemory(2, capacity, distinct=True)
        plain = [PlainMemory(capacity) for _ in range(2)]
        for i, (run, (observation, action, following, end, reward)) in enumerate(happenings):
            if i == cut:
                memory = rebuilt(memory, 2, capacity)
            memory.add(run, observation, action, reward, end, following)
            plain[run].add(observation, action, following, end, reward)
            for which in (0, 1):
                assert memory.size(which) == len(plain[which].kept)
                assert remembered(memory, which) == expected(plain[which])
                assert sorted(memory.tried[which, : memory.size(which)].tolist()) == sorted(
                    plain[which].tried(kept) for kept in plain[which].kept
                )

    def test_there_is_room_for_more_than_at_first(self):
        memory = ReplayMemory(2, 100_000, distinct=True)
        for i in range(5_000):
            memory.add(0, i, i % 7, -float(i), 0, i + 1)
        memory.add(1, 4, 2, -1.0, 1, 0)
        again = rebuilt(memory, 2, 100_000)
        for item in (memory, again):
            assert (item.size(0), item.size(1)) == (5_000, 1)
            assert (item.observation[0, :5_000] == np.arange(5_000)).all()
            assert (item.reward[0, :5_000] == -np.arange(5_000.0)).all()
            item.add(0, 17, 3, -1.0, 0, 18)
            assert (item.size(0), item.seen[0, 17]) == (5_000, 2)


class TestWhatIsDrawn:
    def test_every_transition_is_as_likely_however_often_it_was_seen(self):
        memory = ReplayMemory(2, 10, distinct=True)
        for i in (0, 1, 1, 1, 2, 3):
            memory.add(0, i, 0, 0.0, 0, 0)
        memory.add(1, 0, 0, 0.0, 0, 0)
        uniforms = Uniforms([0.0, 0.24, 0.26, 0.5, 0.74, 0.76, 1 - 2**-53])
        slots, weights = memory.draw([uniforms, uniforms], 7)
        assert slots.tolist() == [[0, 0, 1, 2, 2, 3, 3], [0] * 7]
        assert (weights == 1.0).all()

    def test_outcomes_of_a_choice_count_as_often_as_they_were_seen(self):
        memory = ReplayMemory(1, 10, distinct=True)
        for following in (5, 5, 6, 5):
            memory.add(0, 1, 2, 0.0, 0, following)
        memory.add(0, 1, 3, 0.0, 0, 5)
        slots, weights = memory.draw([Uniforms([0.1, 0.5, 0.9])], 3)
        assert slots.tolist() == [[0, 1, 2]]
        assert weights.tolist() == [[0.75, 0.25, 1.0]]

    def test_what_was_forgotten_no_longer_counts(self):
        memory = ReplayMemory(1, 2, distinct=True)
        for following in (5, 6, 7):
            memory.add(0, 1, 2, 0.0, 0, following)
        slots, weights = memory.draw([Uniforms([0.1, 0.9])], 2)
        assert memory.next_observation[0, slots[0]].tolist() == [7, 6]
        assert weights.tolist() == [[0.5, 0.5]]


class TestGoingOn:
    def test_what_was_read_draws_and_forgets_alike(self):
        memory, generator = ReplayMemory(2, 30, distinct=True), np.random.default_rng(0)

        def happens(first, seed):
            chance = np.random.default_rng(seed)
            for _ in range(25):
                run, observation, action, following = chance.integers([2, 6, 2, 6]).tolist()
                first.add(run, observation, action, -float(chance.random()), 0, following)
            first.add(0, 0, 0, 0.0, 0, 0)
            first.add(1, 0, 0, 0.0, 0, 0)
            slots, weights = first.draw([np.random.default_rng([seed, run]) for run in (0, 1)], 16)
            return slots.tobytes() + weights.tobytes()

        happens(memory, generator.integers(99))
        for seed in range(8):
            other = rebuilt(memory, 2, 30)
            assert happens(memory, seed) == happens(other, seed)
            mine, theirs = memory.arrays("m"), other.arrays("m")
            assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine)

    def test_arrays_of_others_are_refused(self):
        memory = ReplayMemory(2, 30)
        with pytest.raises(ValueError, match="missing or of another shape"):
            ReplayMemory(3, 30).read("m", memory.arrays("m"))


class TestFirstInFirstOut:
    def test_every_transition_is_stored_and_the_oldest_are_overwritten(self):
        memory = ReplayMemory(1, 4)
        for reward in (-1.0, -2.0, -3.0, -4.0, -5.0):
            memory.add(0, 1, 2, reward, 0, 3)
        assert memory.size(0) == 4
        assert sorted(memory.reward[0, :4].tolist()) == [-5.0, -4.0, -3.0, -2.0]
        slots, weights = memory.draw([Uniforms([0.0, 0.3, 0.6, 0.9])], 4)
        assert slots.tolist() == [[0, 1, 2, 3]]
        assert weights.tolist() == [[1.0] * 4]

    def test_it_resumes_from_its_arrays(self):
        memory, other = ReplayMemory(2, 4), ReplayMemory(2, 4)
        for step in range(6):
            memory.add(step % 2, step, 0, -float(step), 0, step + 1)
        other.read("m", memory.arrays("m"))
        for one in (memory, other):
            one.add(0, 9, 1, -9.0, 1, 9)
        mine, theirs = memory.arrays("m"), other.arrays("m")
        assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine)
