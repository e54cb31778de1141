"""Goals out of reach, found before any search."""

from hypothesis import given

from situations import assembly, graph_of, make_skill, make_task, model_of, small_assemblies
from skillplan.task import Facts, find_unreachable_facts

FACTS = Facts(("a", "b", "c", "d"))


def test_a_goal_that_nothing_brings_about_is_named():
    """With the reason; what can be reached is not named."""
    task = make_task(FACTS, [make_skill(FACTS, "do", add=("a",))], goal=("a", "b"))
    lost = find_unreachable_facts(task)
    assert list(lost) == ["b"]
    assert lost["b"].startswith("no action brings it about")


def test_a_goal_whose_makers_lack_something_says_what():
    """The first maker and what it needs in vain."""
    skills = [
        make_skill(FACTS, "make_b", requires=("c",), add=("b",)),
        make_skill(FACTS, "make_c", requires=("d",), add=("c",)),
    ]
    lost = find_unreachable_facts(make_task(FACTS, skills, goal=("b",)))
    assert lost == {"b": "make_b needs c, which nothing brings about."}


def test_an_unlikely_outcome_reaches_a_goal_as_well():
    """Every outcome counts."""
    skills = [make_skill(FACTS, "try", outcomes=[(0.99, (), ()), (0.01, ("a",), ())])]
    assert find_unreachable_facts(make_task(FACTS, skills, goal=("a",))) == {}


@given(small_assemblies())
def test_no_goal_is_called_out_of_reach_that_some_state_fulfils(content):
    """It is a relaxation: what it loses is lost."""
    task = assembly(content)
    reached = set().union(*graph_of(model_of(task)))
    assert not set(find_unreachable_facts(task)) & reached
