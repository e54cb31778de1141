"""Relations of what comes before what."""

from hypothesis import given
from hypothesis import strategies as st

from skillplan.chart import ClosedRelation, break_cycles, closure

NODES = "abcdef"
pairs = st.sets(st.tuples(st.sampled_from(NODES), st.sampled_from(NODES)))


@given(pairs)
def test_a_closed_relation_tells_element_by_element_what_its_pairs_tell(drawn):
    """Also on a circle, where an element comes before itself."""
    closed = closure(drawn)
    relation = ClosedRelation(closed)
    for node in NODES:
        assert relation.before(node) == {first for first, other in closed if other == node}
        assert relation.after(node) == {other for left, other in closed if left == node}


@given(pairs)
def test_without_the_pairs_that_close_cycles_a_relation_has_none(drawn):
    kept, closing = break_cycles(drawn, NODES)
    assert kept | closing == drawn
    assert not kept & closing
    assert not any(first == other for first, other in closure(kept))


@given(pairs)
def test_each_pair_that_closes_a_cycle_leads_back_to_where_the_others_come_from(drawn):
    """None is taken out in vain: together with what is kept it makes a cycle."""
    kept, closing = break_cycles(drawn, NODES)
    for first, other in closing:
        assert first == other or (other, first) in closure(kept)
