"""The apex map and the leg tick by tick, on batches."""

import os
import signal
import threading
import time

import numpy as np
import pytest

from spring_leg import Plant

RNG = np.random.default_rng(5)
APEXES = RNG.uniform([-3, 1], [3, 4], (2000, 2))
ACTIONS = RNG.uniform([0.9, 0], [2.2, 1.5], (2000, 2))


def test_a_batch_has_the_bits_of_single_hops():
    plant = Plant(density_ratio=0.7)
    next_ones = plant.hop(APEXES, ACTIONS)
    assert next_ones.shape == (2000, 2) and next_ones.dtype == np.float64
    singles = np.array([plant.hop(*pair) for pair in zip(APEXES, ACTIONS)])
    assert np.array_equal(next_ones, singles, equal_nan=True)
    fell = np.isnan(next_ones[:, 0])
    assert 100 < fell.sum() < 1900


def test_the_course_of_a_hop_tells_its_events():
    plant = Plant(density_ratio=1)
    course = plant.course(APEXES, ACTIONS)
    next_ones = plant.hop(APEXES, ACTIONS)
    assert np.array_equal(course["vx_m_s"], next_ones[:, 0], equal_nan=True)
    assert np.array_equal(course["fell"], np.isnan(next_ones[:, 0]))
    up = ~course["fell"] & (course["stances"] == 1) & ~course["in_stance"]
    assert up.sum() > 100
    times = [course[name][up] for name in ("touchdown_t_s", "liftoff_t_s", "t_s")]
    assert (np.diff(times, axis=0) > 0).all() and (times[0] > 0).all()


def test_ticks_reproduce_the_apex_map():
    plant = Plant(density_ratio=1)
    course = plant.course(APEXES, ACTIONS)
    one_stance = np.flatnonzero(~course["fell"] & (course["stances"] == 1))[:200]
    zeros = np.zeros(len(one_stance))
    states = np.stack([zeros, APEXES[one_stance, 0], APEXES[one_stance, 1], zeros], axis=1)
    angle, speed = ACTIONS[one_stance].T
    landed_s = course["touchdown_t_s"][one_stance]
    legs = plant.ticks(states)
    reached, dt_s = {}, 0.005
    for tick in range(4000):
        # A ramp that passes 0 at the touchdown.
        elongation_m = speed * (tick * dt_s - landed_s)
        legs.step(dt_s, np.stack([angle, elongation_m, speed], axis=1))
        for event in legs.events:
            if event["kind"] == "apex":
                reached.setdefault(event["leg"], event["state"][[1, 2]])
        if len(reached) == len(one_stance):
            break
    found = np.array([reached[row] for row in range(len(one_stance))])
    expected = np.stack([course["vx_m_s"], course["y_m"]], axis=1)[one_stance]
    assert np.abs(found - expected).max() < 1e-9


def test_each_row_may_have_its_medium():
    ratios = np.linspace(0, 1, 2000)
    mixed = Plant().hop(APEXES, ACTIONS, density_ratio=ratios)
    for row in [0, 700, 1999]:
        alone = Plant(density_ratio=ratios[row]).hop(APEXES[row], ACTIONS[row])
        assert np.array_equal(mixed[row], alone, equal_nan=True)
    everywhere = Plant().hop(APEXES, ACTIONS, density_ratio=0.5)
    assert np.array_equal(everywhere, Plant(density_ratio=0.5).hop(APEXES, ACTIONS), equal_nan=True)


def test_phases_feet_and_lengths_of_legs():
    legs = Plant().ticks([[0, 0.5, 2, 0], [5, 0, 1.001, 0]])
    assert len(legs) == 2 and legs.phases.tolist() == [0, 0]
    assert np.isnan(legs.feet).all()
    for _ in range(60):
        legs.step(1e-3, [[1.6, 0, 0], [np.pi / 2, 0, 0]])
    assert legs.phases.tolist() == [0, 1]
    assert legs.feet[1] == pytest.approx([5, 0], abs=1e-9)
    assert legs.leg_lengths_m[1] < legs.leg_lengths_m[0]
    one = Plant().ticks([0, 0.5, 2, 0])
    assert one.step(1e-3, [1.6, 0, 0]).shape == one.states.shape == (4,)


def test_losses_change_the_stance():
    states = [[0, 0.5, 2, 0]]
    heights = []
    for losses in [{}, {"damping_n_s_m": 50}, {"foot_mass_kg": 2}, {"friction": 0.3}]:
        legs = Plant().ticks(states, **losses)
        legs.step(2.0, [[1.9, 0, 0]])
        heights.append(legs.states[0, 2])
    assert len(set(heights)) == 4


@pytest.mark.parametrize(
    "call, what",
    [
        (lambda: Plant(density_ratio=-1), "density_ratio is -1"),
        (lambda: Plant(tolerance_m_s=0), "tolerance_m_s"),
        (lambda: Plant("cow"), "there is no leg 'cow'"),
        (lambda: Plant({"mass_kg": 1.0}), "leg: missing field"),
        (lambda: Plant({**Plant().leg, "mass_kg": -1.0}), "mass_kg is -1"),
        (lambda: Plant().hop([1, 2, 3], [1, 2]), r"apexes has the shape \(3,\)"),
        (lambda: Plant().hop([[1, 2]] * 3, [[1, 2]] * 2), "apexes has 3 rows and actions 2"),
        (lambda: Plant().hop([1, 2], [1, 2], density_ratio=[0, 1]), "density_ratio has the shape"),
        (lambda: Plant().hop([1, 2], [1, 2], density_ratio=-1), "density_ratio is -1"),
        (lambda: Plant().hop(["a", "b"], [1, 2]), "could not convert"),
        (lambda: Plant().ticks([0, 0, 2, 0], friction=9), "friction is 9"),
        (lambda: Plant().ticks([0, 0, 2, 0]).step(0, [1, 0, 0]), "dt_s is 0"),
        (lambda: Plant().ticks([0, 0, 2, 0]).step(1, [[1, 0, 0]] * 2), "the batch has 1 rows"),
    ],
)
def test_bad_arguments_raise_a_sentence(call, what):
    with pytest.raises(ValueError, match=what):
        call()


def test_what_is_not_finite_is_a_fall():
    hops = Plant().hop([[np.nan, 2], [0, np.inf], [0, 2]], [[1.6, 0], [1.6, 0], [np.nan, 0]])
    assert np.isnan(hops).all()


def test_other_threads_run_during_a_batch():
    apexes, actions = np.tile(APEXES, (300, 1)), np.tile(ACTIONS, (300, 1))
    counted, done = 0, threading.Event()

    def hop():
        Plant(density_ratio=1).hop(apexes, actions)
        done.set()

    threading.Thread(target=hop).start()
    while not done.is_set():
        counted += 1
        time.sleep(0)
    assert counted > 100


def test_an_interrupt_ends_a_large_batch(interrupt):
    apexes, actions = np.tile(APEXES, (400, 1)), np.tile(ACTIONS, (400, 1))
    plant = Plant(density_ratio=1)
    interrupt(0.05)
    with pytest.raises(KeyboardInterrupt):
        plant.hop(apexes, actions)
    assert plant.hop(APEXES, ACTIONS).shape == (2000, 2)


def test_a_forked_process_hops_too():
    plant = Plant(density_ratio=1)
    expected = plant.hop(APEXES, ACTIONS)
    child = os.fork()
    if child == 0:
        same = np.array_equal(plant.hop(APEXES, ACTIONS), expected, equal_nan=True)
        os._exit(0 if same else 1)
    for _ in range(600):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        pytest.fail("the forked process hangs")
    assert os.waitstatus_to_exitcode(status) == 0
