"""Skills whose effect depends on the state, and what rests on them."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import make_skill, make_task
from skillplan.checks import Feasibility
from skillplan.errors import NotASequencing
from skillplan.model import SequencingProblem, SkillModel, TabularMDP
from skillplan.pipeline import solve
from skillplan.task import (
    Case,
    CaseCost,
    Condition,
    ConstantCost,
    DistanceReward,
    Facts,
    Metric,
    Outcome,
    Skill,
    find_unreachable_facts,
)

PLACES = tuple(f"at({i})" for i in range(5))
FACTS = Facts((*PLACES, "blocked"), exclusive=(PLACES,))


def move(start, end, **more):
    """Return the case of moving between two places."""
    delete = FACTS.of(PLACES[start]) if start != end else FACTS.none
    outcome = Outcome(1.0, FACTS.of(PLACES[end]), delete)
    values = {"forbids": FACTS.none, **more}
    return Case(FACTS.of(PLACES[start]), (outcome,), **values)


def right(cases=None, **changes):
    """Return the skill that goes one place to the right, not beyond the last."""
    values = {
        "name": "right",
        "kind": "right",
        "agents": ("robot",),
        "precondition": Condition(FACTS.none, FACTS.of("at(4)")),
        "outcomes": (),
        "cost": ConstantCost(1.0),
        "duration_s": CaseCost({FACTS.bit(name): 1.0 + i for i, name in enumerate(PLACES)}),
        "cases": tuple(move(i, i + 1) for i in range(4)) if cases is None else cases,
        **changes,
    }
    return Skill(**values)


def corridor(**changes):
    """Return the task of walking from place 0 to place 3."""
    return make_task(FACTS, [right()], initial=("at(0)",), goal=("at(3)",), **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outcomes": (Outcome(1.0, FACTS.none, FACTS.none),)}, "beside its cases"),
        ({"cases": (move(0, 1), move(0, 2))}, "two cases for one fact"),
        ({"cases": ()}, "at least one outcome"),
    ],
)
def test_an_unsound_skill_with_cases_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        right(**changes)


def test_a_case_is_selected_by_exactly_one_fact():
    nothing = (Outcome(1.0, FACTS.none, FACTS.none),)
    for fact in (FACTS.none, FACTS.of("at(0)", "at(1)")):
        with pytest.raises(ValueError, match="selected by one fact"):
            Case(fact, nothing, FACTS.none)


def test_the_probabilities_of_a_case_sum_to_1():
    with pytest.raises(ValueError, match=r"sum to 0\.5"):
        Case(FACTS.of("at(0)"), (Outcome(0.5, FACTS.none, FACTS.none),), FACTS.none)
    with pytest.raises(ValueError, match="at least one outcome"):
        Case(FACTS.of("at(0)"), (), FACTS.none)


@given(st.integers(0, 4))
def test_what_it_does_depends_on_the_fact_that_holds(place):
    """It moves one place on, and is not applicable where no case fits."""
    skill, state = right(), FACTS.of(PLACES[place])
    assert skill.applicable(state) == (place < 4)
    if place < 4:
        assert list(skill.prediction_in(state).apply(state)) == [PLACES[place + 1]]
    else:
        with pytest.raises(ValueError, match="no case"):
            skill.outcomes_in(state)


def test_what_a_case_forbids_makes_the_skill_inapplicable():
    skill = right(cases=(move(0, 1, forbids=FACTS.of("blocked")),))
    assert skill.applicable(FACTS.of("at(0)"))
    blocked = FACTS.of("at(0)", "blocked")
    assert not skill.applicable(blocked)
    assert list(skill.why_not(blocked).forbids) == ["blocked"]
    verdict = Feasibility(corridor()).verdict(skill, blocked)
    assert verdict.reason == "needs not blocked"


def test_where_no_case_fits_any_of_their_facts_would_do():
    skill = right(precondition=Condition(FACTS.none, FACTS.none))
    verdict = Feasibility(corridor()).verdict(skill, FACTS.of("at(4)"))
    assert verdict.reason == "needs one of at(0), at(1), at(2), at(3)"


def test_its_verdict_rests_on_the_case_it_was_asked_about():
    state = FACTS.of("at(1)")
    verdict = Feasibility(corridor()).verdict(right(), state)
    assert list(verdict.present) == ["at(1)"]
    assert verdict.applies_in(state)
    assert not verdict.applies_in(FACTS.of("at(2)"))


def test_its_prediction_is_what_all_cases_have_in_common():
    """Nothing, for a walk; the arrival, where every case leads to one place."""
    assert right().prediction == Outcome(1.0, FACTS.none, FACTS.none)
    homing = right(cases=(move(1, 0), move(2, 0)))
    assert list(homing.prediction.add) == ["at(0)"]
    assert len(homing.effects) == 2


def test_a_case_with_two_outcomes_is_left_to_chance():
    slip = Case(
        FACTS.of("at(0)"),
        (
            move(0, 1).outcomes[0].__class__(0.9, FACTS.of("at(1)"), FACTS.of("at(0)")),
            Outcome(0.1, FACTS.none, FACTS.none),
        ),
        FACTS.none,
    )
    assert right().deterministic
    assert not right(cases=(slip,)).deterministic


def test_it_survives_pickling():
    again = pickle.loads(pickle.dumps(right()))
    assert again == right()
    assert again.case(FACTS.of("at(2)")) == move(2, 3)


def test_exact_search_proves_a_walk():
    result = solve(corridor(), "exact")
    assert (result.status, result.cost) == ("optimal", 3.0)
    assert result.makespan_s == 1 + 2 + 3


def test_a_place_beyond_a_gap_is_out_of_reach():
    gap = make_task(
        FACTS, [right(cases=(move(0, 1), move(2, 3)))], initial=("at(0)",), goal=("at(3)",)
    )
    assert find_unreachable_facts(gap) == {
        "at(3)": "right needs at(2), which nothing brings about."
    }


def test_other_starts_are_among_the_states_of_the_arrays():
    """A policy answers from them, too."""
    model = SkillModel(Feasibility(corridor()))
    assert len(TabularMDP.from_model(model).states) == 4
    starts = tuple(FACTS.of(name) for name in PLACES)
    model = SkillModel(Feasibility(corridor(starts=starts)))
    mdp = TabularMDP.from_model(model)
    assert set(mdp.states) == set(starts)
    assert mdp.states[0] == model.initial


def test_rewards_are_minus_the_costs_where_the_task_has_no_scheme():
    mdp = TabularMDP.from_model(SkillModel(Feasibility(corridor())))
    assert list(mdp.rewards) == [-1.0, -1.0, -1.0]


def test_a_task_with_cases_is_no_sequencing_problem():
    with pytest.raises(NotASequencing, match="depends on the state"):
        SequencingProblem.from_model(SkillModel(Feasibility(corridor())))


class TestCaseCost:
    """A value by the fact that holds."""

    cost = CaseCost({1: 2.0, 2: 3.0, 4: 5.0})

    def test_it_is_the_value_of_the_fact_that_holds(self):
        assert self.cost.at(FACTS.of("at(1)")) == 3.0

    def test_it_has_no_value_where_none_of_its_facts_holds(self):
        with pytest.raises(ValueError, match="No value"):
            self.cost.at(FACTS.of("at(4)"))

    def test_its_lower_bound_is_the_least_that_is_left_open(self):
        assert self.cost.least(0, 0) == 2.0
        assert self.cost.least(0, 1) == 3.0
        assert self.cost.least(4, 0) == 5.0
        assert self.cost.least(0, 7) == float("inf")

    @pytest.mark.parametrize("values", [{}, {1: -1.0}, {1: float("nan")}, {1: float("inf")}])
    def test_unsound_values_are_refused(self, values):
        with pytest.raises(ValueError, match=r"must be finite and >= 0|at least one"):
            CaseCost(values)


class TestDistanceReward:
    """Eqs 6 and 7 of Veeramani and Muthuswamy."""

    def test_the_step_that_arrives_is_paid_one_more(self):
        """The distance is that of the position before the step."""
        reward = DistanceReward({1: 0.0, 2: 0.5}, complete=1.0, infeasible=-3.0)
        here = FACTS.of("at(1)")
        assert reward.of_step(here, "B1", 1.0, goal=False, out_of_time=False) == -0.5
        assert reward.of_step(here, "B1", 1.0, goal=True, out_of_time=False) == 0.5

    @pytest.mark.parametrize(
        ("values", "message"),
        [
            ({"distances": {1: -0.1}}, "Distances"),
            ({"distances": {1: float("nan")}}, "Distances"),
            ({"complete": float("inf")}, "Rewards"),
            ({"infeasible": float("nan")}, "Rewards"),
        ],
    )
    def test_unsound_figures_are_refused(self, values, message):
        sound = {"distances": {1: 0.0}, "complete": 1.0, "infeasible": -1.0}
        with pytest.raises(ValueError, match=message):
            DistanceReward(**{**sound, **values})


def test_a_preset_names_skills_of_the_task():
    with pytest.raises(ValueError, match="preset names unknown skill 'left'"):
        corridor(preset=("left",))
    assert corridor(preset=("right",)).preset == ("right",)


def test_a_metric_that_counts_prints_no_decimals():
    task = corridor().replace(metric=Metric("steps", "steps", 0))
    assert task.cost_text(3.0) == "3 steps"
    with pytest.raises(ValueError, match="decimals"):
        Metric("steps", "steps", -1)


def test_walking_past_a_place_is_a_skill_like_any_other():
    """Skills with and without cases stand side by side in one task."""
    jump = make_skill(FACTS, "jump", requires=("at(0)",), add=("at(3)",), delete=("at(0)",), cost=2)
    task = make_task(FACTS, [right(), jump], initial=("at(0)",), goal=("at(3)",))
    result = solve(task, "exact")
    assert [step.skill for step in result.steps] == ["jump"]


def test_exact_search_gets_along_with_costs_that_only_cases_have():
    """The bound asks no cost of a skill in a state where none of its cases fits."""
    cost = CaseCost({FACTS.bit(PLACES[i]): 1.0 for i in range(4)})
    skill = right(cost=cost, precondition=Condition(FACTS.none, FACTS.none))
    other = make_skill(
        FACTS, "leap", requires=("at(0)",), add=("at(4)",), delete=("at(0)",), cost=9
    )
    task = make_task(FACTS, [skill, other], initial=("at(0)",), goal=("at(3)",))
    assert solve(task, "exact").cost == 3.0
