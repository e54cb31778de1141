"""Trainings of a deep learner, and what holds for every one of them."""

import json

import numpy as np
import pytest

from situations import retry_task
from skillplan.env import SkillVectorEnv
from skillplan.pipeline import make_model
from skillplan.solvers import Snapshot
from skillplan.testing import lid_task


def places(learner, runs, task):
    """Return an environment for some runs of a learner."""
    options = learner.options
    return SkillVectorEnv(
        make_model(task),
        runs,
        observation=options.observation,
        mask=options.mask,
        objective=options.objective,
    )


def begun(learner, seeds, task, steps):
    """Return a training at its beginning."""
    return learner.begin(places(learner, len(seeds), task), seeds, steps)


def resumed(learner, seeds, task, snapshot, steps):
    """Return a training from a snapshot, as a file keeps it: notes as JSON, arrays as bytes."""
    kept = Snapshot(
        {name: array.copy() for name, array in snapshot.arrays.items()},
        json.loads(json.dumps(snapshot.notes)),
    )
    return learner.resume(places(learner, len(seeds), task), seeds, steps, kept)


def assert_same(training, other):
    """Compare two trainings bit for bit."""
    first, second = training.snapshot(), other.snapshot()
    assert first.notes == second.notes
    assert first.arrays.keys() == second.arrays.keys()
    for name, array in first.arrays.items():
        assert array.tobytes() == second.arrays[name].tobytes(), name


class DeepLearnerSuite:
    """Tests of a class of learners, by small options."""

    learner = None
    small = None
    steps = 200
    changes = ()

    def solver(self, **options):
        return self.learner(self.learner.Options(**{**self.small, **options}))

    def test_without_a_mask_what_does_not_apply_is_tried_and_ends_the_episode(self):
        task = lid_task()
        episodes = begun(self.solver(mask="none"), [0], task, self.steps).advance(self.steps)
        failed = [episode for episode in episodes if episode.end == "infeasible"]
        assert failed
        applied = []
        for episode in failed:
            *taken, last = (task.skills[action] for action in episode.actions)
            state = task.initial
            for skill in taken:
                assert skill.applicable(state)
                state = skill.prediction.apply(state)
            applied.append(last.applicable(state))
        # What applies and fails all the same is refused by a back end.
        assert not all(applied)

    def test_under_chance_one_episode_tells_nothing_and_none_is_kept(self):
        training = begun(self.solver(), [0], retry_task(0.5), self.steps)
        assert any(episode.success for episode in training.advance(self.steps))
        assert training.learned(0).best is None

    def test_runs_of_other_seeds_differ(self):
        episodes = begun(self.solver(), [0, 1], lid_task(), self.steps).advance(self.steps)
        first, second = ([e.actions for e in episodes if e.run == run] for run in (0, 1))
        assert first != second

    def test_a_snapshot_stays_what_it_was_while_the_training_goes_on(self):
        training = begun(self.solver(), [0], lid_task(), self.steps)
        training.advance(100)
        snapshot = training.snapshot()
        before = {name: array.copy() for name, array in snapshot.arrays.items()}
        notes = json.dumps(snapshot.notes)
        training.advance(100)
        for name, array in before.items():
            np.testing.assert_array_equal(snapshot.arrays[name], array)
        assert json.dumps(snapshot.notes) == notes

    def test_a_snapshot_of_other_options_is_refused(self):
        training = begun(self.solver(), [0], lid_task(), self.steps)
        training.advance(100)
        for change in self.changes:
            with pytest.raises(ValueError, match="snapshot"):
                resumed(self.solver(**change), [0], lid_task(), training.snapshot(), self.steps)
