"""The vector environment: each part is the environment of its seed, with same-step autoreset."""

import copy
import os
import pickle
import signal
import threading

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import spring_leg  # noqa: F401 (registers the environments)
from spring_leg.hopper import HopperEnv, HopperVectorEnv

COUNT = 40


def actions(steps, count=COUNT):
    rng = np.random.default_rng(2)
    return rng.uniform([-0.15, -1], [0.35, 0.6], (steps, count, 2)).astype(np.float32)


@pytest.mark.parametrize("preset", ["robust", "water", "field"])
def test_is_the_sync_vector_env_of_gymnasium_with_same_step_autoreset(preset):
    parts = [lambda: HopperEnv(preset)] * COUNT
    slow = SyncVectorEnv(parts, autoreset_mode=AutoresetMode.SAME_STEP)
    fast = HopperVectorEnv(COUNT, preset)
    assert fast.observation_space == slow.observation_space
    assert fast.action_space == slow.action_space
    assert fast.single_observation_space == slow.single_observation_space
    assert fast.single_action_space == slow.single_action_space
    assert data_equivalence(fast.reset(seed=7), slow.reset(seed=7), exact=True)
    ended = 0
    for action in actions(60):
        ours, theirs = fast.step(action), slow.step(action)
        assert data_equivalence(ours, theirs, exact=True)
        ended += (ours[2] | ours[3]).sum()
    assert ended > COUNT
    mask = np.arange(COUNT) % 3 == 0
    ours = fast.reset(options={"reset_mask": mask})
    theirs = slow.reset(options={"reset_mask": mask})
    assert data_equivalence(ours, theirs, exact=True)
    seeds = [None if i % 2 else i for i in range(COUNT)]
    assert data_equivalence(fast.reset(seed=seeds), slow.reset(seed=seeds), exact=True)


def test_is_what_make_vec_makes():
    env = gymnasium.make_vec("spring_leg/Hopper-v0", num_envs=6)
    assert isinstance(env, HopperVectorEnv) and env.num_envs == 6
    assert env.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    assert env.spec.id == "spring_leg/Hopper-v0"
    water = gymnasium.make_vec("spring_leg/Hopper-v0", num_envs=2, preset="water")
    assert water.preset == "water"
    sync = gymnasium.make_vec("spring_leg/Hopper-v0", num_envs=2, vectorization_mode="sync")
    assert isinstance(sync, SyncVectorEnv)
    with pytest.raises(ValueError, match="num_envs is 0"):
        HopperVectorEnv(0)


def test_what_it_returned_is_not_changed_by_a_later_step():
    env = HopperVectorEnv(4)
    kept = [env.reset(seed=1)[0]]
    copies = [kept[0].copy()]
    for action in actions(10, 4):
        answer = env.step(action)
        kept += [part for part in answer if isinstance(part, np.ndarray)]
        copies += [part.copy() for part in answer if isinstance(part, np.ndarray)]
    assert all(np.array_equal(a, b) for a, b in zip(kept, copies))


def test_unseeded_environments_start_differently():
    starts = np.concatenate([HopperVectorEnv(COUNT).reset()[0] for _ in range(2)])
    assert len({start.tobytes() for start in starts}) == 2 * COUNT


@pytest.mark.parametrize(
    "bad",
    [np.zeros((3, 2)), np.zeros((4, 3)), np.zeros(2), np.full((4, 2), np.nan), np.full((4, 2), 1.5)],
    ids=["too few", "too wide", "one", "nan", "out of range"],
)
def test_bad_actions_raise_and_change_nothing(bad):
    env, other = HopperVectorEnv(4), HopperVectorEnv(4)
    env.reset(seed=3), other.reset(seed=3)
    with pytest.raises(ValueError):
        env.step(bad)
    good = actions(1, 4)[0]
    assert data_equivalence(env.step(good), other.step(good), exact=True)


def test_misuse_raises():
    env = HopperVectorEnv(4)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((4, 2)))
    with pytest.raises(ResetNeeded):
        env.reset(options={"reset_mask": np.array([True, False, False, False])})
    with pytest.raises(ValueError, match="3 seeds for 4 environments"):
        env.reset(seed=[1, 2, 3])
    with pytest.raises(ValueError, match="one true value"):
        env.reset(options={"reset_mask": np.zeros(4, bool)})
    with pytest.raises(TypeError, match="booleans"):
        env.reset(options={"reset_mask": [1, 1, 1, 1]})


def test_a_copy_goes_on_where_its_original_was():
    env = HopperVectorEnv(COUNT, "field")
    env.reset(seed=2)
    for action in actions(7):
        env.step(action)
    pickled, copied = pickle.loads(pickle.dumps(env)), copy.deepcopy(env)
    for action in actions(20):
        answer = env.step(action)
        assert data_equivalence(pickled.step(action), answer, exact=True)
        assert data_equivalence(copied.step(action), answer, exact=True)
    mask = np.arange(COUNT) == 1
    expected = env.reset(options={"reset_mask": mask})
    assert data_equivalence(pickled.reset(options={"reset_mask": mask}), expected, exact=True)


def test_an_interrupt_leaves_it_usable(interrupt):
    env = HopperVectorEnv(256)
    env.reset(seed=1)
    batch = actions(1, 256)[0]
    # One after the other: two at once would count as one.
    for _ in range(5):
        interrupt(0.02)
        with pytest.raises(KeyboardInterrupt):
            while True:
                env.step(batch)
    other = HopperVectorEnv(256)
    assert data_equivalence(env.reset(seed=4), other.reset(seed=4), exact=True)
    assert data_equivalence(env.step(batch), other.step(batch), exact=True)


def test_a_forked_process_steps_too():
    env = HopperVectorEnv(256)
    env.reset(seed=1)
    env.step(actions(1, 256)[0])
    child = os.fork()
    if child == 0:
        env.step(actions(1, 256)[0])
        os._exit(7)
    timer = threading.Timer(60, os.kill, (child, signal.SIGKILL))
    timer.start()
    _, status = os.waitpid(child, 0)
    timer.cancel()
    assert os.waitstatus_to_exitcode(status) == 7
