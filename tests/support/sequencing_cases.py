"""Tasks that are almost sequencing problems, and the best order of one by dynamic programming."""

from __future__ import annotations

import math
import random
from dataclasses import replace

from situations import assembly, fake_back_end
from skillplan.task import CaseCost, Condition, ConstantCost, Outcome, Verdict


def cheapest_order(problem):
    """Return the least cost of an order and the order, or None where there is none.

    Dynamic program over down-sets of the precedence relation, independent of exact search.
    """
    n = len(problem.jobs)
    before = [{i for i, j in problem.precedence if j == job} for job in range(n)]
    layer = {(frozenset({j}), j): (problem.first[j], (j,)) for j in range(n) if not before[j]}
    for _ in range(n - 1):
        following = {}
        for (done, last), (cost, order) in layer.items():
            for job in range(n):
                if job not in done and before[job] <= done:
                    key = (done | {job}, job)
                    total = cost + problem.costs[last, job]
                    if key not in following or total < following[key][0]:
                        following[key] = (total, (*order, job))
        layer = following
    best = min(layer.values(), default=(0.0, ()) if n == 0 else (math.inf, ()))
    return best if math.isfinite(best[0]) else None


def sound(task, limit=4_000):
    """Whether a task keeps its own word: costs are told, and of exclusive facts one holds."""
    groups = [sum(task.facts.bit(fact) for fact in group) for group in task.facts.exclusive]
    todo, seen = [task.initial], {task.initial}
    while todo:
        state = todo.pop()
        if len(seen) > limit or any((state.bits & group).bit_count() > 1 for group in groups):
            return False
        for skill in task.skills:
            if skill.applicable(state):
                try:
                    skill.cost.at(state), skill.duration_s.at(state)
                except ValueError:
                    return False
                following = skill.prediction.apply(state)
                if following not in seen:
                    seen.add(following)
                    todo.append(following)
    return True


def changed_board(content, seed, changes):
    """Return the task of a small board, changed in some places as no domain would."""
    rng = random.Random(seed)
    content = {**content, "chart": []}
    while len(content["parts"]) + len(content["screws"]) > 4:
        content["screws" if content["screws"] else "parts"].popitem()
    task = assembly(content).replace(step_limit=60)
    for _ in range(changes):
        task = _changed(task, rng)
    return task


def _changed(task, rng):
    facts, names = task.facts, task.facts.names
    kind = rng.choice(
        ["needs", "bars", "adds", "deletes", "frees", "copy", "goal", "initial", "cost", "table"]
    )
    index = rng.randrange(len(task.skills))
    skill = task.skills[index]
    needs, bars = skill.precondition.requires, skill.precondition.forbids
    add, delete = skill.prediction.add, skill.prediction.delete
    fact = facts.of(rng.choice(names))
    more = ()
    if kind == "needs":
        needs, bars = needs | fact, bars - fact
    elif kind == "bars":
        needs, bars = needs - fact, bars | fact
    elif kind == "adds":
        add, delete = add | fact, delete - fact
    elif kind == "deletes":
        add, delete = add - fact, delete | fact
    elif kind == "frees":
        dropped = facts.of(rng.choice([*needs, *bars] or names))
        needs, bars = needs - dropped, bars - dropped
    elif kind == "goal":
        left = rng.choice(list(task.operations.values()))
        return task.replace(goal=Condition(task.goal.requires - facts.of(left), facts.none))
    elif kind == "initial":
        bits = task.initial.bits ^ fact.bits
        return task.replace(initial=facts.state(bits))
    if kind == "copy":
        cost = ConstantCost(rng.choice([0.0, 0.05, 0.5]))
        more = (replace(skill, name=f"other_{len(task.skills)}", cost=cost),)
        precondition, outcomes, cost = skill.precondition, skill.outcomes, skill.cost
    else:
        precondition, outcomes = Condition(needs, bars), (Outcome(1.0, add, delete),)
        cost = skill.cost
    if kind == "cost":
        cost = ConstantCost(rng.choice([0.0, 0.2]))
    elif kind == "table":
        # By what has become of a part, or which tool is held.
        group = rng.choice(facts.exclusive)
        cost = CaseCost({facts.bit(name): rng.choice([0.1, 0.4, 0.9]) for name in group})
    changed = replace(skill, precondition=precondition, outcomes=outcomes, cost=cost)
    skills = (*task.skills[:index], changed, *task.skills[index + 1 :], *more)
    return task.replace(skills=skills)


def strict_back_end(task, seed):
    """Return a back end that rules some skills out by a few facts, at random, and says which."""
    rng = random.Random(seed)
    clauses = {}
    for skill in task.skills:
        drawn = []
        while rng.random() < 0.15:
            kinds = [name for name in task.facts.names if name.startswith(_TELLING)]
            chosen = rng.sample(kinds if rng.random() < 0.9 else task.facts.names, 1)
            chosen += [rng.choice(kinds)] if rng.random() < 0.25 else []
            drawn.append([(name, rng.random() < 0.4) for name in dict.fromkeys(chosen)])
        clauses[skill.name] = drawn

    def rule(skill, state):
        present, absent = set(), set()
        for clause in clauses[skill.name]:
            wrong = [name for name, holds in clause if (name in state) != holds]
            if not wrong:
                here = [name for name, holds in clause if holds]
                gone = [name for name, holds in clause if not holds]
                return Verdict.infeasible(
                    "ruled out", task.facts.of(*present, *here), task.facts.of(*absent, *gone)
                )
            (present if wrong[0] in state else absent).add(wrong[0])
        return Verdict.feasible(task.facts.of(*present), task.facts.of(*absent))

    return fake_back_end(task, rule)


_TELLING = ("placed", "fastened", "at_start")
