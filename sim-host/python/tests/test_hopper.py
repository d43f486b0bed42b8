"""The environment of Gymnasium: today's definitions, checks, misuse, seeds, pickles."""

import copy
import json
import pickle
import signal
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import spring_leg  # noqa: F401 (registers the environments)
from spring_leg.hopper import HopperEnv

IDS = ["Hopper", "HopperWater", "HopperAir", "HopperField"]

# Lines of the program `trainer env`, whose starts, hops and rewards these are, to the last bit.
GOLDEN = json.loads(Path(__file__).with_name("golden.json").read_text())
# The network's input is (apex - OFFSET) * SCALE in `robust` and `field`.
OFFSET = np.array([0, 2.5, 0.5], np.float32)
SCALE = np.array([1 / 3, 0.4, 2], np.float32)


def observed(preset, apex):
    apex = np.array(apex, np.float32)
    return (apex - OFFSET) * SCALE if preset in ("robust", "field") else apex


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden["preset"])
def test_has_the_starts_hops_and_rewards_of_the_trainer(golden):
    preset, env = golden["preset"], HopperEnv(golden["preset"])
    seed = golden["seed"]
    for step in golden["steps"]:
        if "reset" in step:
            observation, info = env.reset(seed=seed)
            seed = None
            assert np.array_equal(observation, observed(preset, step["reset"])) and info == {}
        else:
            answer = env.step(np.array(step["action"], np.float32))
            assert np.array_equal(answer[0], observed(preset, step["apex"]))
            assert answer[1] == step["reward"]
            assert answer[2] == (step["ended"] == "fall") and answer[3] == (step["ended"] == "time")


@pytest.mark.parametrize("name", IDS)
def test_passes_the_check_of_gymnasium_without_warnings(name):
    check_env(gymnasium.make(f"spring_leg/{name}-v0").unwrapped)
    check_env(gymnasium.make(f"spring_leg/{name}-v0", render_mode="rgb_array").unwrapped)


def test_is_made_by_its_id_with_its_spec():
    env = gymnasium.make("spring_leg/Hopper-v0", preset="water")
    assert env.spec.id == "spring_leg/Hopper-v0" and env.unwrapped.preset == "water"
    assert not env.spec.nondeterministic
    again = gymnasium.make(env.spec)
    assert again.unwrapped.preset == "water"
    with pytest.raises(ValueError, match="there is no preset 'sea'; choose one of water, air"):
        gymnasium.make("spring_leg/Hopper-v0", preset="sea")
    with pytest.raises(ValueError, match="render_mode is 'ansi'"):
        HopperEnv(render_mode="ansi")


def test_observations_stay_within_finite_bounds():
    env = HopperEnv("field")
    space = env.observation_space
    assert np.isfinite(space.low).all() and np.isfinite(space.high).all()
    env.action_space.seed(3)
    observation, _ = env.reset(seed=3)
    furthest = np.zeros(3)
    for _ in range(5000):
        assert observation in space
        furthest = np.maximum(furthest, np.abs(observation / space.high))
        observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            observation, _ = env.reset()
    # Vertical and horizontal: none comes near its bound.
    assert furthest[:2].max() < 0.5


def test_unseeded_environments_start_differently():
    starts = {HopperEnv().reset()[0].tobytes() for _ in range(8)}
    assert len(starts) == 8
    env = HopperEnv()
    assert not np.array_equal(env.reset()[0], env.reset()[0])


def test_the_same_seed_gives_the_same_episodes():
    def course(env, seed):
        observations = [env.reset(seed=seed)[0]]
        env.action_space.seed(1)
        for _ in range(50):
            observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
            observations.append(observation)
            if terminated or truncated:
                observations.append(env.reset()[0])
        return np.array(observations)

    used = HopperEnv()
    used.reset(seed=1)
    first = course(used, 8)
    assert np.array_equal(course(used, 8), first)
    assert np.array_equal(course(HopperEnv(), 8), first)
    assert not np.array_equal(course(used, 9)[0], first[0])


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_a_seed_out_of_range_is_refused(seed):
    with pytest.raises((ValueError, gymnasium.error.Error)):
        HopperEnv().reset(seed=seed)


BAD_ACTIONS = [
    [0.1],
    [0.1, 0.2, 0.3],
    [[0.1, 0.2]],
    0.5,
    [float("nan"), 0],
    [0, float("inf")],
    [1.01, 0],
    [0, -1.01],
    ["x", 0],
    [[1, 2], [3]],
]


@pytest.mark.parametrize("bad", BAD_ACTIONS, ids=str)
def test_a_bad_action_raises_and_changes_nothing(bad):
    env, other = HopperEnv(), HopperEnv()
    env.reset(seed=5), other.reset(seed=5)
    with pytest.raises(ValueError):
        env.step(bad)
    ours, theirs = env.step([0.1, -1]), other.step([0.1, -1])
    assert np.array_equal(ours[0], theirs[0]) and ours[1:] == theirs[1:]


def test_a_step_outside_an_episode_raises_and_changes_nothing():
    env, other = HopperEnv(), HopperEnv()
    with pytest.raises(ResetNeeded):
        env.step([0, 0])
    env.reset(seed=5), other.reset(seed=5)
    for each in [env, other]:
        while not any(each.step([-1, 0])[2:4]):
            pass
    for _ in range(2):
        with pytest.raises(ResetNeeded):
            env.step([0, 0])
    assert np.array_equal(env.reset()[0], other.reset()[0])


@pytest.mark.parametrize("preset", ["robust", "field"])
@pytest.mark.parametrize("steps", [None, 0, 3, "end"])
def test_a_copy_goes_on_where_its_original_was(preset, steps):
    env = HopperEnv(preset)
    actions = np.random.default_rng(4).uniform([0, -1], [0.1, -0.5], (400, 2)).astype(np.float32)
    if steps is not None:
        env.reset(seed=11)
        ended = False
        for action in actions[: 100 if steps == "end" else steps]:
            ended = ended or any(env.step(action)[2:4])
            if ended and steps == "end":
                break
            assert not ended
        assert ended == (steps == "end")
    for other in [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]:
        mine = pickle.loads(pickle.dumps(env))
        needs_reset = steps in (None, "end")
        for action in actions[100:]:
            if needs_reset:
                # Of an environment that was not seeded, the copy has its entropy, too.
                seed = 3 if steps is None else None
                assert np.array_equal(mine.reset(seed=seed)[0], other.reset(seed=seed)[0])
            ours, theirs = mine.step(action), other.step(action)
            assert np.array_equal(ours[0], theirs[0]) and ours[1:] == theirs[1:]
            needs_reset = ours[2] or ours[3]


class Interrupt(Exception):
    pass


def test_stays_in_step_after_interrupts():
    def interrupt(*_):
        raise Interrupt

    env, other = HopperEnv(), HopperEnv()
    env.reset(seed=1), other.reset(seed=1)
    before = signal.signal(signal.SIGALRM, interrupt)
    interrupted, played = 0, 0
    try:
        while interrupted < 100:
            try:
                signal.setitimer(signal.ITIMER_REAL, 1e-4 * (1 + interrupted % 7))
                while True:
                    if not env._hoppers.are_running:
                        env.reset()
                    env.step([0.05, -0.8])
                    played += 1
            except Interrupt:
                interrupted += 1
                signal.setitimer(signal.ITIMER_REAL, 0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert played > 100
    assert np.array_equal(env.reset(seed=1)[0], other.reset(seed=1)[0])
    assert np.array_equal(env.step([0.05, -0.8])[0], other.step([0.05, -0.8])[0])


def test_tells_an_action_in_its_units():
    env = HopperEnv()
    assert env.physical_action([-1, -1]) == pytest.approx([np.pi / 10, 0], rel=1e-6)
    assert env.physical_action([1, 1]) == pytest.approx([np.pi / 1.2, 2], rel=1e-6)
