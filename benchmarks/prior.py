"""The relational policy as a prior of proofs on generated boards of 20 to 60 parts.

The portfolio proves every board without its local search, three times: with the greedy plan of
the policy as incumbent, with the plan of a short local search, and with the optimum, which bounds
the savings of any incumbent. `auto` is the portfolio as it is. Times are processor times.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from skillplan.model.policy_value import roll_out
from skillplan.model.sequencing import SequencingProblem
from skillplan.pipeline.solving import make_model
from skillplan.solvers.ordering.instance import Integers, JobOrders, OrderingInstance
from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing, build_greedy
from skillplan.solvers.ordering.portfolio import METHODS, OrderingSearch, warm_up
from skillplan.training.family_training import GeneratedFamily, read_policy

# Moves of the short local search per node.
_MOVES = 500


@dataclass(frozen=True)
class Trial:
    """A search for a proof; `nodes` are states and subproblems."""

    order: Integers
    proved: bool
    nodes: int
    search_s: float
    start_s: float
    above: float = 0.0


def main() -> None:
    """Print a line for every board and incumbent, then sums."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("run", type=Path, help="of train --family generated:A-B")
    parser.add_argument("--boards", type=int, default=40, help="generated boards")
    parser.add_argument("--seed", type=int, default=560, help="of those")
    parser.add_argument("--seconds", type=float, default=6.0, help="of each search [s]")
    options = parser.parse_args()
    policy = read_policy(options.run).policy
    warm_up()
    trials: dict[str, list[Trial]] = {}
    for task in GeneratedFamily(20, 60).tasks(options.boards, options.seed):
        model = make_model(task)
        problem = SequencingProblem.from_model(model)
        orders = JobOrders(problem)
        instance = orders.instance
        whole = search(instance, None, 0.0, options.seconds)
        begin_s = time.process_time()
        jobs = problem.order([skill.name for skill in roll_out(model, policy.choice_on(model))])
        policy_s = time.process_time() - begin_s
        begin_s = time.process_time()
        starts = {"local search": (improve(instance), time.process_time() - begin_s)}
        starts["optimum"] = (whole.order, 0.0)
        if jobs is not None:
            starts["policy"] = (orders.nodes(jobs), policy_s)
        trials.setdefault("auto", []).append(whole)
        for name, (start, start_s) in starts.items():
            trial = search(instance, start, start_s, options.seconds, instance.cost(whole.order))
            trials.setdefault(name, []).append(trial)
        for name, results in trials.items():
            show(f"{task.name} {name}", results[-1:])
    for name, results in trials.items():
        show(f"all {name}", results)


def improve(instance: OrderingInstance) -> Integers:
    """Return the order of a short local search."""
    order = build_greedy(instance)
    portions = Annealing(instance, 0).portions(order, instance.cost(order), _MOVES * instance.n)
    *_, (best, _) = portions
    return best


def search(
    instance: OrderingInstance,
    start: Integers | None,
    start_s: float,
    seconds: float,
    optimum: float | None = None,
) -> Trial:
    """Search with all methods, or from a start with all but local search."""
    above = 0.0 if start is None or not optimum else instance.cost(start) / optimum - 1
    begin_s = time.process_time()
    methods = tuple(name for name in METHODS if start is None or name != "local-search")
    ordering = OrderingSearch(
        instance, methods, start=start, stop=lambda: time.process_time() > begin_s + seconds
    )
    ordering.run()
    assert ordering.order is not None
    nodes = ordering.effort.states + ordering.effort.parts
    search_s = time.process_time() - begin_s
    return Trial(ordering.order, ordering.proved, nodes, search_s, start_s, above)


def show(name: str, trials: list[Trial]) -> None:
    """Print the sums of some trials."""
    above = [trial.above for trial in trials]
    print(
        f"{name:52} above {median(above):.2%}, at most {max(above):.2%}, found in "
        f"{sum(trial.start_s for trial in trials):.2f} s; {sum(trial.proved for trial in trials)} "
        f"of {len(trials)} proved, {sum(trial.nodes for trial in trials):,} nodes, "
        f"{sum(trial.search_s for trial in trials):.2f} s"
    )


if __name__ == "__main__":
    main()
