"""Networks side by side: each is what it would be alone, and what its policy says."""

import numpy as np
import pytest
import torch

from skillplan_torch import BatchedAdam, BatchedNetwork, padded

# Features and actions of the board, of a larger one, and of a network without hidden layers.
SHAPES = [[17, 64, padded(16)], [83, 96, 32, padded(41)], [5, padded(3)]]


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    """As the learners have it."""
    torch.set_num_threads(1)


def network(sizes, seeds, **more):
    return BatchedNetwork(sizes, [np.random.default_rng(seed) for seed in seeds], **more)


def observed(sizes, seeds, count=64):
    """Return observations of every run, which depend on its seed alone."""
    drawn = [np.random.default_rng([seed, 9]).random((count, sizes[0])) for seed in seeds]
    return torch.from_numpy(np.stack(drawn).astype(np.float32))


def trained(sizes, seeds, steps=20):
    """Return networks after some steps towards outputs of 1."""
    trained_network = network(sizes, seeds)
    adam = BatchedAdam(trained_network.parameters)
    seen = observed(sizes, seeds)
    for _ in range(steps):
        adam.minimise((trained_network(seen) - 1.0).square().mean((1, 2)).sum(), 1e-2)
    return trained_network, adam


class TestBatchedNetwork:
    @pytest.mark.parametrize("sizes", SHAPES)
    def test_its_outputs_are_the_scores_of_its_policies(self, sizes):
        trained_network, actions = network(sizes, [3, 4]), sizes[-1] - 15
        seen = observed(sizes, [3, 4])
        outputs = trained_network(seen).detach().numpy()
        for run in (0, 1):
            scores = trained_network.policy(run, actions).scores(seen[run].numpy())
            np.testing.assert_allclose(scores, outputs[run, :, :actions], rtol=1e-4, atol=1e-5)

    @pytest.mark.parametrize("sizes", SHAPES)
    def test_one_observation_a_run_gives_what_many_give(self, sizes):
        trained_network, seen = network(sizes, [3, 4]), observed(sizes, [3, 4])
        outputs = trained_network(seen).detach().numpy()
        for i in range(seen.shape[1]):
            np.testing.assert_allclose(
                trained_network.evaluate(seen[:, i].numpy()), outputs[:, i], rtol=1e-4, atol=1e-5
            )

    @pytest.mark.parametrize("sizes", SHAPES)
    @pytest.mark.parametrize("runs", [2, 3, 5, 10])
    def test_what_a_run_learns_is_the_same_alone_and_among_others(self, sizes, runs):
        together, _ = trained(sizes, range(runs))
        for run in (0, runs - 1):
            alone, _ = trained(sizes, [run])
            numpy = observed(sizes, range(runs), 1)[:, 0].numpy()
            assert (alone.evaluate(numpy[[run]])[0] == together.evaluate(numpy)[run]).all()
            for mine, ours in zip(alone.parameters, together.parameters, strict=True):
                assert (mine[0] == ours[run]).all()

    def test_at_first_outputs_spread_as_far_as_is_asked_for(self):
        wide = network([400, 512, 512], [0])
        narrow = network([400, 512, 512], [0], last_gain=0.01)
        seen = torch.from_numpy(
            np.random.default_rng(1).standard_normal((1, 64, 400)).astype(np.float32)
        )
        # Half of what is rectified is 0, so that its mean square is half its variance.
        assert wide(seen).std().item() == pytest.approx(1.0, abs=0.1)
        assert narrow(seen).std().item() == pytest.approx(0.01, abs=0.001)

    def test_a_copy_goes_its_own_way(self):
        trained_network, _ = trained(SHAPES[0], [0])
        twin, before = (
            trained_network.copy(),
            trained_network.evaluate(np.ones((1, 17), dtype=np.float32)),
        )
        with torch.no_grad():
            trained_network.parameters[0].add_(1.0)
        assert (twin.evaluate(np.ones((1, 17), dtype=np.float32)) == before).all()
        assert (trained_network.evaluate(np.ones((1, 17), dtype=np.float32)) != before).any()

    def test_it_approaches_another_by_a_share_of_the_way(self):
        trained_network, other = network([2, 32], [0]), network([2, 32], [1])
        before = trained_network.copy()
        trained_network.approach(other, 0.25)
        for now, then, aim in zip(
            *(n.parameters for n in (trained_network, before, other)), strict=True
        ):
            expected = (0.75 * then + 0.25 * aim).detach().numpy()
            np.testing.assert_allclose(now.detach().numpy(), expected, rtol=1.3e-6, atol=1e-5)

    @pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
    def test_a_run_with_a_figure_that_is_not_finite_is_named(self, wrong):
        trained_network = network(SHAPES[0], [0, 1, 2])
        assert trained_network.is_finite().tolist() == [True, True, True]
        with torch.no_grad():
            trained_network.parameters[-1][1, 0, 3] = wrong
        assert trained_network.is_finite().tolist() == [True, False, True]
        with pytest.raises(ValueError, match="finite"):
            trained_network.policy(1, 16)
        assert trained_network.policy(2, 16).actions == 16

    def test_a_policy_stays_what_it_was(self):
        trained_network, seen = network(SHAPES[0], [0]), np.ones((1, 17), dtype=np.float32)
        policy = trained_network.policy(0, 16)
        before = policy.scores(seen)
        with torch.no_grad():
            trained_network.parameters[-1].add_(1.0)
        assert (policy.scores(seen) == before).all()


class TestBatchedAdam:
    def test_it_takes_the_steps_of_the_formula(self):
        """Kingma and Ba (2015), algorithm 1."""
        trained_network, seen = network([5, 32], [0]), observed([5], [0])
        adam, weight = BatchedAdam(trained_network.parameters), trained_network.parameters[0]
        theirs, mean, spread = weight.detach().double().numpy().copy(), 0.0, 0.0
        for step in range(1, 11):
            loss = (trained_network(seen) - 2.0).square().mean()
            (gradient,) = torch.autograd.grad(loss, [weight], retain_graph=True)
            gradient = gradient.double().numpy()
            mean = 0.9 * mean + 0.1 * gradient
            spread = 0.999 * spread + 0.001 * gradient**2
            root = np.sqrt(spread / (1 - 0.999**step))
            theirs -= 3e-3 * mean / (1 - 0.9**step) / (root + 1e-8)
            adam.minimise(loss, 3e-3)
        np.testing.assert_allclose(weight.detach().numpy(), theirs, rtol=1e-4, atol=1e-6)

    @pytest.mark.slow(reason="what the library loads for it; by the formula in every run")
    def test_it_takes_the_steps_of_the_library_s(self):
        mine, theirs = network([5, 32, 32], [0, 1]), network([5, 32, 32], [0, 1])
        adam = BatchedAdam(mine.parameters)
        reference = torch.optim.Adam(theirs.parameters, lr=3e-3)
        seen = observed([5], [0, 1])
        for _ in range(30):
            adam.minimise((mine(seen) - 2.0).square().mean(), 3e-3)
            reference.zero_grad()
            (theirs(seen) - 2.0).square().mean().backward()
            reference.step()
        for parameter, other in zip(mine.parameters, theirs.parameters, strict=True):
            torch.testing.assert_close(parameter, other, rtol=1e-4, atol=1e-6)

    def test_a_gradient_that_is_not_finite_stays_in_its_run(self):
        trained_network, seen = network(SHAPES[0], [0, 1]), observed(SHAPES[0], [0, 1])
        adam = BatchedAdam(trained_network.parameters)
        weights = torch.tensor([1.0, torch.nan])[:, None, None]
        adam.minimise((trained_network(seen) * weights).mean((1, 2)).sum(), 1e-3)
        assert trained_network.is_finite().tolist() == [True, False]


class TestGoingOn:
    def test_it_goes_on_from_its_arrays_bit_for_bit(self):
        seen = observed(SHAPES[0], [0, 1])
        trained_network, adam = trained(SHAPES[0], [0, 1])
        arrays = trained_network.arrays("a") | adam.arrays("b")
        other = network(SHAPES[0], [7, 8])
        theirs = BatchedAdam(other.parameters)
        other.read("a", arrays)
        theirs.read("b", arrays)
        for item, its in ((trained_network, adam), (other, theirs)):
            its.minimise(item(seen).square().mean(), 1e-3)
        for mine, ours in zip(other.parameters, trained_network.parameters, strict=True):
            assert (mine == ours).all()

    def test_arrays_stay_what_they_were(self):
        trained_network, adam = trained(SHAPES[0], [0])
        arrays = trained_network.arrays("a") | adam.arrays("b")
        before = {name: array.copy() for name, array in arrays.items()}
        adam.minimise(trained_network(observed(SHAPES[0], [0])).sum(), 1e-3)
        assert all((array == before[name]).all() for name, array in arrays.items())

    def test_arrays_of_another_network_are_refused(self):
        trained_network = network(SHAPES[0], [0])
        fault = "The snapshot's a.1 is missing or of another shape"
        for other in ({}, {"a.1": np.zeros((1, 1, 32), dtype=np.float32)}):
            arrays = {
                key: array for key, array in trained_network.arrays("a").items() if key != "a.1"
            }
            with pytest.raises(ValueError, match=fault):
                trained_network.read("a", arrays | other)


@pytest.mark.parametrize(("count", "blocks"), [(1, 32), (31, 32), (32, 32), (33, 64), (65, 96)])
def test_counts_are_rounded_up_to_whole_blocks(count, blocks):
    assert padded(count) == blocks
