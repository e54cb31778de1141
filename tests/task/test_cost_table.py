"""A cost by where one stands: what it is, and that its bound is one."""

import math
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.task import NEVER, Cost, Facts, TableCost

FACTS = Facts(("done(a)", "at(0)", "at(1)", "at(2)", "done(b)"))
PLACES = FACTS.of("at(0)", "at(1)", "at(2)")
TABLE = TableCost(PLACES, (4, NEVER, 2))


class TestTableCost:
    def test_it_is_the_value_of_the_place(self):
        """Whatever else holds."""
        assert 4.0 == TABLE.at(FACTS.of("at(0)"))
        assert 2.0 == TABLE.at(FACTS.of("at(2)", "done(a)", "done(b)"))

    def test_it_is_infinite_where_the_skill_is_never_done(self):
        """No search goes that way."""
        assert math.inf == TABLE.at(FACTS.of("at(1)"))

    @pytest.mark.parametrize("names", [(), ("done(a)",), ("at(0)", "at(2)")])
    def test_a_state_that_does_not_say_the_place_is_refused(self, names):
        """As one that says two."""
        with pytest.raises(ValueError, match="gives no single place"):
            TABLE.at(FACTS.of(*names))

    @given(st.lists(st.integers(-1, 9), min_size=3, max_size=3), st.integers(0, 31), st.data())
    def test_its_bound_is_the_least_over_the_places_left_open(self, values, true_bits, data):
        """Admissible, and tight."""
        false_bits = data.draw(st.integers(0, 31)) & ~true_bits
        table = TableCost(PLACES, tuple(values))
        states = [FACTS.of(f"at({place})") for place in range(3)]
        left = [
            table.at(state)
            for state in states
            if not state.bits & false_bits and not true_bits & PLACES.bits & ~state.bits
        ]
        assert min(left, default=math.inf) == table.least(true_bits, false_bits)

    def test_it_is_a_cost_and_survives_a_process(self):
        """Workers are handed tasks pickled."""
        assert isinstance(TABLE, Cost)
        TABLE.least(0, 0)
        again = pickle.loads(pickle.dumps(TABLE))
        assert again == TABLE
        assert hash(again) == hash(TABLE)
        assert 2.0 == again.least(0, 0)

    @pytest.mark.parametrize(
        ("names", "values", "message"),
        [
            (("at(0)", "at(2)"), (1, 2), "side by side"),
            ((), (), "side by side"),
            (("at(0)", "at(1)"), (1,), "needs 2 values"),
            (("at(0)", "at(1)"), (1, -2), "not -2"),
        ],
    )
    def test_a_table_that_does_not_fit_is_refused(self, names, values, message):
        """By what is wrong with it."""
        with pytest.raises(ValueError, match=message):
            TableCost(FACTS.of(*names), values)
