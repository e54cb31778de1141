"""Situations: their numbers, and what is known of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.solvers import ObservationCounts, double_rows, take_rows

ACTIONS = 3


def bits(number, width=12):
    """Return an observation that tells one number from another."""
    return np.array([number >> i & 1 for i in range(width)], dtype=np.float32)


def mask(number):
    """Return a mask that allows something and depends on the observation alone."""
    return np.array([True, number % 2 == 0, number % 3 == 0])


def met(counts, numbers):
    """Return the numbers of what every run observes."""
    return counts.indices(
        np.stack([bits(n) for n in numbers]), np.stack([mask(n) for n in numbers])
    ).tolist()


def rebuilt(counts, runs):
    other = ObservationCounts(runs, 12, ACTIONS)
    other.read("s", counts.arrays("s"))
    return other


class TestNumbers:
    def test_they_are_given_in_the_order_in_which_a_run_meets_them(self):
        counts = ObservationCounts(2, 12, ACTIONS)
        assert met(counts, [5, 8]) == [0, 0]
        assert met(counts, [6, 8]) == [1, 0]
        assert met(counts, [5, 5]) == [0, 1]
        assert [counts.known(run) for run in (0, 1)] == [2, 2]

    @settings(max_examples=examples(50))
    @given(
        st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), max_size=60), st.integers(0, 60)
    )
    def test_they_are_those_of_a_plain_dictionary_also_where_they_are_read_again(self, way, cut):
        counts, known = ObservationCounts(2, 12, ACTIONS), ({}, {})
        for i, both in enumerate(way):
            if i == cut:
                counts = rebuilt(counts, 2)
            result = met(counts, both)
            for run, seen in enumerate(both):
                assert result[run] == known[run].setdefault(seen, len(known[run]))
        for run, numbers in enumerate(known):
            assert counts.known(run) == len(numbers)
            for seen, number in numbers.items():
                assert (counts.observations[run, number] == bits(seen)).all()
                assert (counts.masks[run, number] == mask(seen)).all()


class TestGrowth:
    def test_there_is_room_for_more_than_at_first(self):
        counts = ObservationCounts(2, 12, ACTIONS)
        first = counts.visits.shape[1]
        for number in range(3 * first):
            # The second run meets one situation only.
            assert met(counts, [number, 7]) == [number, 0]
            counts.visits[0, number, number % ACTIONS] += number
        assert counts.visits.shape[1] >= 3 * first
        for item in (counts, rebuilt(counts, 2)):
            for number in range(0, 3 * first, 97):
                assert (item.observations[0, number] == bits(number)).all()
                assert item.visits[0, number].sum() == number
                assert met(item, [number, 7]) == [number, 0]
            assert item.known(0) == 3 * first
            assert item.known(1) == 1

    def test_what_is_double_rows_begins_with_what_was_there(self):
        assert double_rows(np.array([[1, 2], [3, 4]])).tolist() == [[1, 2, 0, 0], [3, 4, 0, 0]]


class TestGoingOn:
    def test_arrays_are_as_long_as_what_is_known(self):
        counts = ObservationCounts(2, 12, ACTIONS)
        assert counts.arrays("s")["s.tried"].shape == (2, 1, ACTIONS)
        met(counts, [1, 1])
        met(counts, [2, 1])
        assert counts.arrays("s")["s.tried"].shape == (2, 2, ACTIONS)

    def test_arrays_of_others_are_refused(self):
        counts = ObservationCounts(2, 12, ACTIONS)
        met(counts, [1, 2])
        for shape in ((3, 12, ACTIONS), (2, 11, ACTIONS), (2, 12, ACTIONS + 1)):
            with pytest.raises(ValueError, match="missing or of another shape"):
                ObservationCounts(*shape).read("s", counts.arrays("s"))


@settings(max_examples=examples(30))
@given(st.integers(1, 4), st.integers(1, 9), st.integers(0, 6), st.integers(0, 99))
def test_entries_take_rows_are_those_at_their_indices(runs, size, count, seed):
    generator = np.random.default_rng(seed)
    indices = generator.integers(size, size=(runs, count))
    for array in (generator.random((runs, size)), generator.random((runs, size, 2))):
        expected = [[array[run, i] for i in row] for run, row in enumerate(indices)]
        np.testing.assert_array_equal(
            take_rows(array, indices), np.array(expected).reshape(runs, count, *array.shape[2:])
        )
