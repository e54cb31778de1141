"""Kept policies: which one stands for a run, and at what cost."""

import json

import numpy as np
import pytest

from skillplan.solvers import BestPolicies, CompletedEpisode, NetworkPolicy


def preferring(*actions, count=3):
    """Return a policy that takes the i-th of some actions where the i-th bit is observed."""
    weight = np.zeros((len(actions), count), dtype=np.float32)
    weight[np.arange(len(actions)), actions] = 1.0
    return NetworkPolicy((weight,), (np.zeros(count, dtype=np.float32),))


def completed(cost, *actions, masks=None):
    """Return an episode in which the i-th bit is observed before the i-th action."""
    count = len(actions)
    allowed = np.ones((count, 3), dtype=np.bool_) if masks is None else np.array(masks)
    return CompletedEpisode(cost, np.eye(count, dtype=np.float32), allowed, np.array(actions))


@pytest.fixture
def kept():
    return BestPolicies(1, keeps=True)


def best(kept, run=0):
    """Return what is kept as (cost, step)."""
    learned = kept.learned(run, preferring(0))
    return learned.best_cost, learned.best_step


class TestWhatIsKept:
    def test_without_an_episode_that_completes_there_is_none(self, kept):
        kept.compare(0, 5, None, preferring(1, 2))
        assert best(kept) == (None, None)
        assert kept.learned(0, preferring(0)).best is None

    def test_a_policy_that_does_what_the_episode_did_is_kept_at_its_cost(self, kept):
        policy = preferring(1, 2)
        kept.compare(0, 5, completed(3.0, 1, 2), policy)
        assert best(kept) == (3.0, 5)
        assert kept.learned(0, preferring(0)).best is policy

    def test_one_that_does_something_else_on_the_way_is_not(self, kept):
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(1, 0))
        assert best(kept) == (None, None)

    def test_masks_hold_for_what_it_would_do(self, kept):
        masks = [[True, True, True], [False, True, True]]
        # It likes the first action best, which is barred, and of the others the first.
        kept.compare(0, 5, completed(3.0, 1, 1, masks=masks), preferring(1, 0))
        assert best(kept) == (3.0, 5)

    def test_a_later_policy_is_held_against_the_cheapest_episode_so_far(self, kept):
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(0, 0))
        kept.compare(0, 9, completed(4.0, 2, 1), preferring(2, 1))
        assert best(kept) == (4.0, 9)
        # The episode failed, but the policy would follow the cheap one now.
        kept.compare(0, 12, None, preferring(1, 2))
        assert best(kept) == (3.0, 12)

    def test_a_more_expensive_one_does_not_replace_it(self, kept):
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(1, 2))
        kept.compare(0, 9, completed(4.0, 2, 1), preferring(2, 1))
        assert best(kept) == (3.0, 5)

    @pytest.mark.parametrize("cost", [3.0, 3.0 - 1e-12])
    def test_of_equals_the_first_stays(self, kept, cost):
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(1, 2))
        kept.compare(0, 9, completed(cost, 2, 1), preferring(2, 1))
        assert best(kept) == (3.0, 5)

    def test_the_last_policy_is_handed_over_beside_it(self, kept):
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(1, 2))
        last = preferring(0)
        assert kept.learned(0, last).last is last

    def test_runs_do_not_see_each_other(self):
        kept = BestPolicies(2, keeps=True)
        kept.compare(1, 5, completed(3.0, 1, 2), preferring(1, 2))
        kept.compare(0, 6, None, preferring(1, 2))
        assert best(kept, 0) == (None, None)
        assert best(kept, 1) == (3.0, 5)

    def test_where_one_episode_tells_nothing_none_is_kept(self):
        kept = BestPolicies(1, keeps=False)
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(1, 2))
        assert best(kept) == (None, None)
        assert kept.arrays("k") == {}


class TestGoingOn:
    @pytest.fixture
    def several(self):
        """Run 0 has a policy and a cheaper episode, run 1 only an episode, run 2 nothing."""
        kept = BestPolicies(3, keeps=True)
        kept.compare(0, 5, completed(3.0, 1, 2), preferring(1, 2))
        kept.compare(0, 7, completed(2.5, 2, 1), preferring(1, 2))
        kept.compare(1, 8, completed(2.0, 0, 1), preferring(1, 2))
        return kept

    def test_what_was_read_keeps_alike(self, several):
        other = BestPolicies(3, keeps=True)
        other.read("k", several.arrays("k"), json.loads(json.dumps(several.document())))
        assert [best(other, run) for run in range(3)] == [(3.0, 5), (None, None), (None, None)]
        ours = other.learned(0, preferring(0)).best
        assert (ours.weights[0] == preferring(1, 2).weights[0]).all()
        for item in (several, other):
            item.compare(0, 9, None, preferring(2, 1))
            item.compare(1, 9, None, preferring(0, 1))
            assert [best(item, run) for run in range(3)] == [(2.5, 9), (2.0, 9), (None, None)]
        mine, theirs = several.arrays("k"), other.arrays("k")
        assert mine.keys() == theirs.keys()
        assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine)

    def test_reading_leaves_nothing_of_what_was_there(self, several):
        empty = BestPolicies(3, keeps=True)
        several.read("k", empty.arrays("k"), empty.document())
        assert [best(several, run) for run in range(3)] == [(None, None)] * 3

    def test_what_is_of_other_runs_is_refused(self, several):
        with pytest.raises(ValueError, match="of other runs"):
            BestPolicies(2, keeps=True).read("k", several.arrays("k"), several.document())

    @pytest.mark.parametrize("name", ["k.1.actions", "k.0.observations", "k.0.0.weight"])
    def test_what_is_not_whole_is_refused(self, several, name):
        arrays = several.arrays("k")
        del arrays[name]
        with pytest.raises(ValueError, match=f"'{name}' is missing"):
            BestPolicies(3, keeps=True).read("k", arrays, several.document())
