"""The environments in Stable-Baselines3, where it is installed."""

import numpy as np
import pytest

sb3 = pytest.importorskip("stable_baselines3")

from stable_baselines3.common.env_checker import check_env  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv  # noqa: E402

from spring_leg.hopper import HopperEnv  # noqa: E402
from spring_leg.sb3 import HopperVecEnv  # noqa: E402

COUNT = 12


@pytest.mark.parametrize("preset", ["robust", "water", "air", "field"])
def test_passes_the_check_of_sb3_without_warnings(preset):
    check_env(HopperEnv(preset))
    check_env(HopperEnv(preset, render_mode="rgb_array"))


def test_is_the_dummy_vec_env_of_sb3():
    fast, slow = HopperVecEnv(COUNT), DummyVecEnv([HopperEnv] * COUNT)
    assert isinstance(fast, VecEnv)
    assert fast.seed(4) == slow.seed(4)
    assert np.array_equal(fast.reset(), slow.reset())
    rng = np.random.default_rng(2)
    ended = 0
    for _ in range(80):
        actions = rng.uniform([-0.15, -1], [0.35, 0.6], (COUNT, 2)).astype(np.float32)
        ours, theirs = fast.step(actions), slow.step(actions)
        for a, b in zip(ours[:3], theirs[:3]):
            assert np.array_equal(a, b) and a.dtype == b.dtype
        for a, b in zip(ours[3], theirs[3]):
            assert a.keys() - {"TimeLimit.truncated"} == b.keys() - {"TimeLimit.truncated"}
            if "terminal_observation" in a:
                ended += 1
                assert np.array_equal(a["terminal_observation"], b["terminal_observation"])
                assert a["TimeLimit.truncated"] == b["TimeLimit.truncated"]
    assert ended > COUNT
    assert fast.get_attr("preset", [1, 2]) == ["robust", "robust"]
    assert fast.env_is_wrapped(sb3.common.monitor.Monitor) == [False] * COUNT
    fast.close()


def test_processes_of_sb3_step_copies():
    env = SubprocVecEnv([HopperEnv] * 2, start_method="fork")
    try:
        env.seed(3)
        alone = HopperVecEnv(2, seed=3)
        assert np.array_equal(env.reset(), alone.reset())
        actions = np.zeros((2, 2), np.float32)
        assert np.array_equal(env.step(actions)[0], alone.step(actions)[0])
    finally:
        env.close()


@pytest.mark.parametrize("algorithm", ["PPO", "TD3"])
def test_an_algorithm_learns_from_it(algorithm):
    env = HopperVecEnv(32, seed=1)
    settings = {"PPO": {"n_steps": 8, "batch_size": 64}, "TD3": {"learning_starts": 64}}
    model = getattr(sb3, algorithm)("MlpPolicy", env, device="cpu", **settings[algorithm])
    before = [parameter.clone() for parameter in model.policy.parameters()]
    model.learn(512)
    assert any(not (a == b).all() for a, b in zip(before, model.policy.parameters()))
