"""The vector environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from spring_leg.hopper import HopperVectorEnv


class HopperVecEnv(VecEnv):
    """`HopperVectorEnv` for the algorithms of Stable-Baselines3: `PPO("MlpPolicy", HopperVecEnv(64))`.

    Its environments run in this process, on all cores.
    """

    def __init__(self, num_envs: int, preset: str = "robust", seed: int | None = None) -> None:
        self.hoppers = HopperVectorEnv(num_envs, preset)
        single = self.hoppers
        # The constructor of VecEnv asks for it.
        self.render_mode: str | None = None
        super().__init__(
            num_envs, single.single_observation_space, single.single_action_space
        )
        self._actions: npt.NDArray[np.float32] | None = None
        if seed is not None:
            self.seed(seed)

    def reset(self) -> npt.NDArray[np.float32]:
        seeds = None if self._seeds[0] is None else self._seeds
        observations, _ = self.hoppers.reset(seed=seeds)
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        # As in the other VecEnvs, seeds and options count for one reset.
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: npt.NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> Any:
        if self._actions is None:
            raise RuntimeError("step_wait without step_async; call step")
        actions, self._actions = self._actions, None
        observations, rewards, terminated, truncated, given = self.hoppers.step(actions)
        ended = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(ended):
            infos[row]["terminal_observation"] = given["final_obs"][row]
            infos[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
        return observations, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        self.hoppers.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Returns an attribute of the hoppers, which is the same for all of them."""
        value = getattr(self if attr_name == "render_mode" else self.hoppers, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        raise AttributeError(f"{attr_name}: the hoppers have no attribute that one of them could set")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        raise AttributeError(f"{method_name}: the hoppers have no method that one of them could run")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        return [None for _ in range(self.num_envs)]
