"""Relations of what comes before what."""

from hypothesis import given
from hypothesis import strategies as st

from skillplan.chart.partial_order import ClosedRelation, closure

NODES = "abcdef"
pairs = st.sets(st.tuples(st.sampled_from(NODES), st.sampled_from(NODES)))


@given(pairs)
def test_a_closed_relation_tells_element_by_element_what_its_pairs_tell(drawn):
    """Also on a circle, where an element comes before itself."""
    closed = closure(drawn)
    relation = ClosedRelation(closed)
    for node in NODES:
        assert relation.before(node) == {one for one, other in closed if other == node}
        assert relation.after(node) == {other for one, other in closed if one == node}
