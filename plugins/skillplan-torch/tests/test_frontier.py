"""Going back to where episodes got to: what is returned to, what is left out, what is kept."""

from __future__ import annotations

import numpy as np
import pytest

from skillplan_torch.dqn.frontier import Frontier
from skillplan_torch.observation_counts import ObservationCounts

ACTIONS, LIMIT = 3, 8
PLACE, OTHER, TOOL = range(ACTIONS)


class Walk:
    """One run in a world of numbers; each step leads to what `world` says, or fails."""

    def __init__(self, world, limit=LIMIT):
        self.world = world
        self.counts = ObservationCounts(1, 1, ACTIONS, True)
        self.generator = np.random.default_rng(0)
        self.frontier = Frontier([self.generator], self.counts, limit)

    def index(self, place, before):
        seen = np.array([[place]], dtype=np.float32)
        allowed = np.array([[(place, action) in self.world for action in range(ACTIONS)]])
        return int(self.counts.indices(seen, allowed, [before])[0])

    def episode(self, most=LIMIT):
        """Follow the frontier from 0 on; return the places met."""
        self.frontier.begin_episode(0)
        place, at, places = 0, self.index(0, -1), [0]
        for _ in range(most):
            action = self.frontier.action(0, at)
            if action is None:
                break
            following = self.world[place, action]
            after = None if following is None else self.index(following, action)
            self.frontier.stepped(0, at, action, after)
            if following is None:
                break
            place, at = following, after
            places.append(place)
        return places


# A corridor of one way on and two that fail at each place.
CORRIDOR = {
    (place, action): place + 1 if action == place % ACTIONS else None
    for place in range(6)
    for action in range(ACTIONS)
}


def test_the_end_of_a_corridor_is_reached_by_going_back_to_where_it_was_left():
    """Each way that fails is taken once, so that 12 failing ones take 13 episodes at most."""
    walk = Walk({**CORRIDOR, (6, PLACE): 6})
    assert any(6 in walk.episode() for _ in range(13))


def test_what_only_leads_to_failing_is_not_entered_again():
    """From 1 all fails, so that 0 goes to 2 ever after."""
    walk = Walk({(0, PLACE): 1, (0, OTHER): 2, (1, PLACE): None, (1, OTHER): None, (2, PLACE): 2})
    met = [walk.episode() for _ in range(8)]
    assert [1 in places for places in met].count(True) <= 2
    assert all(places[1] == 2 for places in met[-3:])


def test_what_is_undone_is_no_progress():
    """A change of tools and back ends where it began; what was placed is gone back to."""
    world = {(0, TOOL): 10, (10, TOOL): 0, (0, PLACE): 1, (1, TOOL): 11, (11, TOOL): 1}
    world |= {(10, OTHER): None, (1, OTHER): None, (11, PLACE): 2, (2, OTHER): 2}
    walk = Walk(world)
    for _ in range(6):
        walk.episode()
    assert walk.episode()[:4] == [0, 1, 11, 2]


@pytest.mark.parametrize("episodes", [3, 9])
def test_what_is_known_is_read_as_it_was_kept(episodes):
    """Both go on alike."""
    walk = Walk(CORRIDOR)
    for _ in range(episodes):
        walk.episode()
    walk.frontier.begin_episode(0)
    again = Walk(CORRIDOR)
    again.counts.read("n", walk.counts.arrays("n"))
    kept = walk.frontier.arrays("f")
    again.frontier.read("f", kept, walk.frontier.plans())
    assert again.frontier.plans() == walk.frontier.plans()
    for key, array in again.frontier.arrays("f").items():
        assert array.tolist() == kept[key].tolist()
    again.generator.bit_generator.state = walk.generator.bit_generator.state
    assert [walk.episode() for _ in range(5)] == [again.episode() for _ in range(5)]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("f.steps", np.zeros((2, 3), dtype=np.int64), "f.steps is missing or of another shape"),
        ("plans", [[], []], "2 ways back for 1 run"),
    ],
)
def test_what_does_not_fit_is_refused(key, value, words):
    walk = Walk(CORRIDOR)
    walk.episode()
    kept, plans = walk.frontier.arrays("f"), walk.frontier.plans()
    if key == "plans":
        plans = value
    else:
        kept[key] = value
    with pytest.raises(ValueError, match=words):
        walk.frontier.read("f", kept, plans)
