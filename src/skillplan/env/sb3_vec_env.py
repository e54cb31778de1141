"""The vector environment as a `VecEnv` of Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import Features, SkillVectorEnv
from skillplan.errors import OptionError

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError as error:
    if (error.name or "").partition(".")[0] != "stable_baselines3":
        raise
    raise ModuleNotFoundError(
        "Sb3VecEnv needs Stable-Baselines3: pip install stable-baselines3", name=error.name
    ) from None

Indices = None | int | Iterable[int]


class Sb3VecEnv(VecEnv):  # type: ignore[misc]
    """Makes a `SkillVectorEnv` usable with Stable-Baselines3 and sb3-contrib, masks included.

    Observations, rewards, ends and seeds equal those of SB3's `DummyVecEnv` of as many single
    environments. Infos hold ``cost`` and ``end`` (0 goes on, 1 complete, 2 infeasible, 3 out of
    time), ``TimeLimit.truncated``, and ``terminal_observation`` if the episode ended.

    Parameters
    ----------
    envs
        Vector environment, such as `gymnasium.make_vec` returns.

    Raises
    ------
    TypeError
        If `envs` is another environment.
    """

    def __init__(self, envs: SkillVectorEnv) -> None:
        if isinstance(envs, gymnasium.vector.VectorWrapper):
            raise TypeError(
                f"Sb3VecEnv takes no wrapper of Gymnasium, such as {type(envs).__name__}: pass the "
                "environment without it. VecMonitor(Sb3VecEnv(envs)) records returns and lengths."
            )
        if not isinstance(envs, SkillVectorEnv):
            raise TypeError(
                f"Sb3VecEnv takes the vector environment that gymnasium.make_vec returns, not a "
                f"{type(envs).__name__}."
            )
        self.envs = envs
        self._actions: NDArray[np.int64] | None = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Features:
        """Start an episode in every sub-environment, with the seeds and options that were set.

        Raises
        ------
        ValueError
            If the options differ between sub-environments.
        gymnasium.error.ClosedEnvironmentError
            If the environment was closed.
        """
        options = self._options[0]
        if any(other != options for other in self._options):
            raise ValueError("The options of all sub-environments must be equal.")
        seeds = None if None in self._seeds else self._seeds
        obs, infos = self.envs.reset(seed=seeds, options=options)
        self.reset_infos = [{"action_mask": mask} for mask in infos["action_mask"]]
        self._reset_seeds()
        self._reset_options()
        return obs

    def step_async(self, actions: NDArray[np.int64]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[Features, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Take the actions.

        Returns
        -------
        observations
            Float32, shape (n, width); of the next episode if one ended.
        rewards
            Float32, shape (n,).
        dones
            Bool, shape (n,): an episode ended.
        infos
            Infos of the class.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset, or no actions were sent.
        gymnasium.error.InvalidAction
            If the number of actions differs, or an action does not exist.
        """
        if self._actions is None:
            raise gymnasium.error.ResetNeeded("There are no actions: call step_async before.")
        obs, rewards, terminations, truncations, ends = self.envs.step(self._actions)
        self._actions = None
        columns = (ends["cost"], ends["end"], truncations)
        infos: list[dict[str, Any]] = [
            {"cost": cost, "end": end, "TimeLimit.truncated": late}
            for cost, end, late in zip(*(column.tolist() for column in columns), strict=True)
        ]
        dones = terminations | truncations
        for index in np.flatnonzero(dones).tolist():
            infos[index]["terminal_observation"] = ends["final_obs"][index]
        return obs, rewards.astype(np.float32), dones, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return an image of every sub-environment, with the render mode ``rgb_array``."""
        return self.env_method("render") if self.render_mode == "rgb_array" else [None]

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of sub-environments, which is the same for all.

        Raises
        ------
        AttributeError
            If they have no such attribute.
        OptionError
            If a sub-environment does not exist.
        """
        places = self._get_indices(indices)
        if attr_name in ("action_masks", "render"):
            return [partial(self._call, attr_name, place) for place in places]
        single = f"single_{attr_name}"
        value = getattr(self.envs, single if hasattr(self.envs, single) else attr_name)
        return [value for _ in places]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Refuse, because sub-environments have no attributes of their own."""
        raise AttributeError(f"Sub-environments have no attribute {attr_name!r} of their own.")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Return the results of ``action_masks`` or ``render`` for sub-environments.

        Raises
        ------
        AttributeError
            If it is another method.
        OptionError
            If a sub-environment does not exist.
        """
        places = self._get_indices(indices)
        results = self.envs.call(method_name, *method_args, **method_kwargs)
        return [results[place] for place in places]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Indices = None
    ) -> list[bool]:
        """Return False for every sub-environment: wrap this environment in `VecMonitor`."""
        return [False for _ in self._get_indices(indices)]

    def _get_indices(self, indices: Indices) -> list[int]:
        """Return the numbers of sub-environments; negative ones count from the end."""
        places = list(super()._get_indices(indices))
        for place in places:
            if not -self.num_envs <= place < self.num_envs:
                raise OptionError(
                    f"Sub-environments have the indices 0 to {self.num_envs - 1}, not {place}."
                )
        return places

    def _call(self, method_name: str, place: int) -> Any:
        return self.env_method(method_name, indices=place)[0]
