"""The YAML schema of costs: path, cycle time, counts that come first, or a weighted sum."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from skillplan.domains.domain import Strict
from skillplan.errors import Issue, name_hint
from skillplan.files.schema_errors import ONE, SEVERAL, WORD, Located
from skillplan.task.task import Metric

Weight = Annotated[float, Field(ge=0, le=1e6)]
Energy = Annotated[float, Field(ge=0, le=1e9)]
Subject = Annotated[str, Field(min_length=1, max_length=200)]

_METRICS: Mapping[str, Metric] = {
    "distance": Metric("distance", "m"),
    "time": Metric("time", "s", decimals=3, is_duration=True),
}
# Skills that end or prepare the use of a tool: they wear it together with the pick or fastening.
_NO_USES = ("place", "load", "offload", "turn")
_J_PER_KJ = 1000.0
# Skills that are counted.
_KINDS: Mapping[str, tuple[str, ...]] = {"holds": ("clamp", "hold"), "turns": ("turn",)}
# Least weight of the last count in the unit of what follows, of which it is a multiple, and weight
# of each count in that of the next.
_LEAST_WEIGHT, _NEXT_WEIGHT = 1e4, 100.0


class CostConfig(Strict):
    """A weighted sum of path, time, wear and energy."""

    unit: Annotated[str, Field(max_length=16)] = Field(
        "", description="unit of the sum, such as ct; left out: a plain number"
    )
    per_m: Weight = Field(
        0.0, description="cost per length of the planar path of the tip, in 'unit' [m]; left out: 0"
    )
    per_s: Weight = Field(
        0.0,
        description="cost per duration of the cycle, dwells and tool changes included, in 'unit' "
        "[s]; left out: 0",
    )
    wear: Annotated[dict[Subject, Weight], Field(max_length=256)] = Field(
        {},
        description="cost of each use, in 'unit': of a tool, for every part that it picks and "
        "every screw that it drives, or of a kind of skill such as load, or of one skill such as "
        "fasten(screw_1); several add up; left out: none",
    )
    energy_j: Annotated[dict[Subject, Energy], Field(max_length=256)] = Field(
        {},
        description="energy of each execution of a kind of skill, such as fasten, or of one skill, "
        "which comes before that of its kind [J]; 'per_m' and 'per_s' price that of travels; left "
        "out: none",
    )
    per_kj: Weight = Field(
        0.0, description="cost per energy of 'energy_j', in 'unit' [kJ]; left out: 0"
    )


Term = Literal["holds", "turns", "time", "distance"]


def _check_order(terms: list[Term]) -> list[Term]:
    last, counts = terms[-1], terms[:-1]
    if last not in _METRICS or any(term in _METRICS for term in counts):
        raise Located("must end with 'time' or 'distance', after 'holds', 'turns' or both.")
    if len(set(counts)) < len(counts):
        raise Located(f"names {counts[0]!r} twice. Leave one out.")
    return terms


CostOrder = Annotated[
    list[Term],
    Field(
        min_length=2,
        max_length=3,
        description="fewest of the first, then of the next, then the least of the last, which is "
        "time or distance; one counts as 10,000 s or m, or as a multiple of it above twice the "
        "arrivals, waits and travels of a plan that does each operation once, and 100 of the "
        "second as one of the first",
    ),
    AfterValidator(_check_order),
]
"""Costs in the order of their importance."""

CostChoice = Annotated[
    Annotated[Literal["distance", "time"], Tag(WORD)]
    | Annotated[CostOrder, Tag(SEVERAL)]
    | Annotated[CostConfig, Tag(ONE)],
    Discriminator(
        lambda value: (
            WORD if isinstance(value, str) else SEVERAL if isinstance(value, list) else ONE
        )
    ),
]
"""A cost by name, costs in order, or a weighted sum."""

Choice = str | list[Term] | CostConfig


class _CountConfig(CostConfig):
    """Counts of skills before the rest of a sum; tools may have the names of kinds of skills."""

    counts: dict[str, float]


@lru_cache(maxsize=64)
def _weigh_terms(terms: tuple[Term, ...], most: float) -> _CountConfig:
    """Return costs in order as a weighted sum, in which a count outweighs the later ones."""
    last, counts = terms[-1], dict[str, float]()
    # Back ends may need more time than the task states.
    weight = _LEAST_WEIGHT * (1 + 2 * most // _LEAST_WEIGHT)
    for term in reversed(terms[:-1]):
        counts |= dict.fromkeys(_KINDS[term], weight)
        weight *= _NEXT_WEIGHT
    per_s = float(last == "time")
    return _CountConfig(unit=_METRICS[last].unit, per_m=1 - per_s, per_s=per_s, counts=counts)


def weigh_cost(cost: Choice, most: float = 0.0) -> str | CostConfig:
    """Return a cost by name, or as a weighted sum.

    Parameters
    ----------
    most
        What comes last in costs in order is not expected to be more than this [s or m].
    """
    return _weigh_terms(tuple(cost), most) if isinstance(cost, list) else cost


def make_metric(cost: Choice, most: float = 0.0) -> Metric:
    """Return the metric of a cost; for `most` see `weigh_cost`."""
    if isinstance(cost, str):
        return _METRICS[cost]
    if isinstance(cost, list):
        sums, last = _weigh_terms(tuple(cost), most), _METRICS[cost[-1]]
        ranks = tuple((term[:-1], sums.counts[_KINDS[term][0]]) for term in cost[:-1])
        rates = tuple(f"{weight:,.0f} {last.unit} per {name}" for name, weight in ranks)
        return Metric("cost", last.unit, last.decimals, per_s=sums.per_s, terms=rates, ranks=ranks)
    per = f"{cost.unit}/" if cost.unit else "1/"
    terms = [f"{weight:g} {per}{unit}" for weight, unit in _list_rates(cost) if weight]
    if cost.wear:
        terms.append(f"wear of {', '.join(cost.wear)}")
    if isinstance(cost, _CountConfig):
        terms += [f"{weight:g} per {kind}" for kind, weight in cost.counts.items()]
    return Metric("cost", cost.unit, decimals=4, per_s=cost.per_s, terms=tuple(terms))


def _list_rates(cost: CostConfig) -> tuple[tuple[float, str], ...]:
    return (cost.per_m, "m"), (cost.per_s, "s"), (cost.per_kj, "kJ")


def compute_fixed_cost(
    cost: CostConfig, kind: str, name: str, parameters: Mapping[str, str]
) -> float:
    """Return wear and energy of one execution of a skill, in the unit of the sum.

    Parameters
    ----------
    kind, name, parameters
        As of the skill, such as ``pick``, ``pick(pcb)`` and ``{"tool": "gripper"}``.
    """
    tool = None if kind in _NO_USES else parameters.get("tool")
    subjects = [subject for subject in (tool, kind, name) if subject is not None]
    wear = sum(cost.wear.get(subject, 0.0) for subject in subjects)
    if isinstance(cost, _CountConfig):
        wear += cost.counts.get(kind, 0.0)
    energy_j = cost.energy_j.get(name, cost.energy_j.get(kind, 0.0))
    return wear + cost.per_kj * energy_j / _J_PER_KJ


def find_cost_issues(
    cost: Choice, tools: Iterable[str], actions: Sequence[str], *, have_holders: bool
) -> Iterator[Issue]:
    """Yield unknown names, and keys and counts without effect, of costs.

    Parameters
    ----------
    tools, actions
        Names of the task's tools and skills.
    have_holders
        True if the task has holders, which may all be set from the start.
    """
    kinds = list(dict.fromkeys(action.partition("(")[0] for action in actions))
    if isinstance(cost, list):
        for number, term in enumerate(cost[:-1]):
            if not set(_KINDS[term]) & set(kinds):
                needed = "'holders'" if term == "holds" else "'workholders'"
                reason = f"the task has no {needed}"
                if term == "holds" and have_holders:
                    reason = "all 'holders' are set from the start ('stays: true')"
                message = f"{term!r} has no effect, as {reason}. Leave it out."
                yield Issue(message, ("cost", number))
        return
    if isinstance(cost, str):
        return
    known = {"wear": [*tools, *kinds, *actions], "energy_j": [*kinds, *actions]}
    for key, names in known.items():
        for subject in getattr(cost, key):
            if subject not in names:
                what = "tool or skill" if key == "wear" else "skill"
                hint = name_hint(subject, names)
                yield Issue(f"unknown {what} {subject!r}. {hint}", ("cost", key, subject))
    if cost.energy_j and not cost.per_kj:
        message = "energies cost nothing without a price. Give 'per_kj' above 0."
        yield Issue(message, ("cost", "energy_j"))
    if cost.per_kj and not any(cost.energy_j.values()):
        message = "no skill has an energy. Give 'energy_j', such as {fasten: 60}."
        yield Issue(message, ("cost", "per_kj"))
    if not any((cost.per_m, cost.per_s, cost.per_kj, *cost.wear.values())):
        message = (
            "all weights are 0, so every plan is the best. Give one of 'per_m', 'per_s', 'wear'."
        )
        yield Issue(message, ("cost",))


def list_cost_names(cost: Choice) -> tuple[str, ...]:
    """Return the names of the costs of a file."""
    names = ["distance", "time"]
    if isinstance(cost, list):
        names += ["cost", *cost[:-1]]
    if isinstance(cost, CostConfig):
        names += ["cost", *(["wear"] if cost.wear else []), *(["energy"] if cost.energy_j else [])]
    return tuple(names)


def choose_cost(cost: Choice, name: str) -> Choice:
    """Return one of the costs that `list_cost_names` lists."""
    if isinstance(cost, str) or name in _METRICS:
        return name
    if name in _KINDS:
        return _CountConfig(unit=name, counts=dict.fromkeys(_KINDS[name], 1.0))
    if isinstance(cost, list):
        return cost
    if name == "wear":
        return CostConfig(unit=cost.unit, wear=cost.wear)
    if name == "energy":
        return CostConfig(unit="J", energy_j=cost.energy_j, per_kj=_J_PER_KJ)
    return cost
