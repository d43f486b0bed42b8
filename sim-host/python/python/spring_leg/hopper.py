"""The hopper as environments of Gymnasium, with the trainer's plant, starts and rewards.

One step is one hop, from apex to apex. An observation is the scaled apex: horizontal velocity,
height, density ratio. An action is the touchdown angle and the elongation speed, each spread over
-1 to 1: `physical_action` returns them in rad and m/s.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from spring_leg._leg import Hoppers
from spring_leg.scene import Scene, Window

Floats = npt.NDArray[np.float32]

_RESET_NEEDED = "an episode has ended or not begun; call reset first"


Box = gymnasium.spaces.Box[np.float32]


def _spaces(preset: str) -> tuple[Box, Box, dict[str, Any]]:
    """Returns the spaces of observations and actions of a preset, and its scalings."""
    scalings = Hoppers.scalings(preset)
    low, high = scalings["observation_low"], scalings["observation_high"]
    actions: Box = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    return gymnasium.spaces.Box(low, high, (3,), np.float32), actions, scalings


def _seed(seed: int) -> int:
    """Returns a seed that the native generators take."""
    if not 0 <= seed < 2**64:
        raise ValueError(f"the seed is {seed}; it must be within 0 and 2^64 - 1")
    return int(seed)


class HopperEnv(gymnasium.Env[Floats, Floats]):
    """A hopper that learns to stop. `preset` is one of the trainer: starts, media, rewards.

    A bad action raises ValueError, and a step before the first reset or after the end of an
    episode ResetNeeded; neither changes anything. A pickled environment goes on where it was.

    With `render_mode="rgb_array"` the method `render` returns a picture of the last apex and of the
    way to it; with `"human"` each step is shown in a window, in real time.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

    def __init__(self, preset: str = "robust", render_mode: str | None = None) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode is {render_mode!r}; choose 'human', 'rgb_array' or None")
        self.render_mode = render_mode
        self.preset = preset
        self.observation_space, self.action_space, self._scalings = _spaces(preset)
        self._hoppers = Hoppers(preset, [0])
        self._is_seeded = False
        self._scene = Scene(1.0)
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begins an episode; returns its first observation. `options` has no effect."""
        super().reset(seed=seed)
        seeds = None
        if seed is not None:
            seeds = [_seed(seed)]
        elif not self._is_seeded:
            # Unseeded environments start differently.
            seeds = [int(self.np_random.integers(2**64, dtype=np.uint64))]
        observations = self._hoppers.reset(seeds)
        self._is_seeded = True
        if self.render_mode is not None:
            apex = self._hoppers.apex(0)
            if apex is not None:
                self._scene = Scene(y_m=apex[1], density_ratio=apex[2])
            self._show()
        return observations[0], {}

    def step(self, action: npt.ArrayLike) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Hops once; returns observation, reward, terminated, truncated and an empty dictionary."""
        if not self._hoppers.are_running:
            raise ResetNeeded(_RESET_NEEDED)
        path = None if self.render_mode is None else self._hoppers.path(action)
        observation, reward, terminated, truncated = self._hoppers.step_one(action)
        if path is not None:
            self._scene.follow(path, float(self.physical_action(action)[0]), self._show)
        return observation, reward, terminated, truncated, {}

    def render(self) -> Any:
        """Returns a picture as (height, width, 3), or `None` with `render_mode="human"`."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() without a render_mode; make it with "rgb_array"')
        return self._scene.drawn() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show(self) -> None:
        """Shows the scene in the window of `human`."""
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window(self.metadata["render_fps"])
            self._window.show(self._scene.drawn())

    def __getstate__(self) -> dict[str, Any]:
        # A window belongs to its process.
        return {**self.__dict__, "_window": None}

    def __deepcopy__(self, memo: dict[int, Any]) -> HopperEnv:
        copied = HopperEnv.__new__(HopperEnv)
        memo[id(self)] = copied
        copied.__dict__.update(copy.deepcopy(self.__getstate__(), memo))
        return copied

    def physical_action(self, action: npt.ArrayLike) -> Floats:
        """Returns an action as touchdown angle in rad and elongation speed in m/s."""
        scaled = np.asarray(action, np.float32) * self._scalings["action_scale"]
        return np.asarray(scaled + self._scalings["action_offset"], np.float32)


class HopperVectorEnv(VectorEnv[Floats, Floats, npt.NDArray[Any]]):
    """Many hoppers, stepped together on all cores.

    Each is the `HopperEnv` of its seed: `reset(seed=s)` gives the environments the seeds s, s + 1
    and so on. An environment whose episode ends begins the next one in the same step: its
    observation is the first of the new episode, and `infos["final_obs"]` has the last of the old,
    as in Gymnasium's own vector environments with `AutoresetMode.SAME_STEP`.
    """

    metadata: dict[str, Any] = {
        "render_modes": [],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(self, num_envs: int = 1, preset: str = "robust") -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; it must be 1 or more")
        self.num_envs = num_envs
        self.preset = preset
        self.single_observation_space, self.single_action_space, _ = _spaces(preset)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = dict(self.metadata)
        self._hoppers = Hoppers(preset, [0] * num_envs)
        self._is_seeded = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Floats, dict[str, Any]]:
        """Begins episodes in all environments, or in those of `options["reset_mask"]`."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        mask = None
        if options is not None and "reset_mask" in options:
            mask = self._mask(options["reset_mask"])
        if seed is None:
            seeds: list[int | None] = [None] * self.num_envs
        elif isinstance(seed, int):
            seeds = [_seed(seed + i) for i in range(self.num_envs)]
        else:
            seeds = [None if one is None else _seed(one) for one in seed]
            if len(seeds) != self.num_envs:
                raise ValueError(f"{len(seeds)} seeds for {self.num_envs} environments")
        if not self._is_seeded:
            drawn = self.np_random.integers(2**64, size=self.num_envs, dtype=np.uint64)
            seeds = [int(new) if one is None else one for one, new in zip(seeds, drawn)]
        observations = self._hoppers.reset(seeds, mask)
        self._is_seeded = True
        return observations, {}

    def _mask(self, mask: npt.NDArray[np.bool_]) -> list[bool]:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError("options['reset_mask'] must be an array of booleans")
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] must have the shape ({self.num_envs},) and one true value"
            )
        if not self._is_seeded and not mask.all():
            raise ResetNeeded("the first reset must be one of all environments")
        chosen: list[bool] = mask.tolist()
        return chosen

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[
        Floats,
        npt.NDArray[np.float64],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
        dict[str, Any],
    ]:
        if not self._hoppers.are_running:
            raise ResetNeeded(_RESET_NEEDED)
        observations, rewards, terminated, truncated, last = self._hoppers.step(actions, True)
        infos: dict[str, Any] = {}
        if len(last):
            ended = terminated | truncated
            final = np.full(self.num_envs, None, object)
            for row, observation in zip(np.flatnonzero(ended), last):
                final[row] = observation
            infos = {
                "final_obs": final,
                "_final_obs": ended,
                "final_info": {},
                "_final_info": ended.copy(),
            }
        return observations, rewards, terminated, truncated, infos
