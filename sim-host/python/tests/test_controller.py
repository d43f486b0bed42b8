"""The control law and the leg are those of the programs, bit for bit."""

import json
import pickle
import threading

import pytest

import spring_leg
from spring_leg import Command, Controller, Leg, Policy, Sample

# As `cargo run --release -- --json` prints them, with its sensors and with `--sensors ideal`.
SHORE = {"imu": "94f1430e0d00a06a", "ideal": "9f9ba2dcdc071032"}


@pytest.mark.parametrize("sensors", SHORE)
def test_plays_the_shore_with_the_bits_of_the_programs(sensors):
    leg = Leg.shore(sensors=sensors)
    controller = leg.controller()
    while leg.ending is None:
        leg.step(controller.tick(leg.sample))
    report = leg.finish()
    assert report["state_hash"] == SHORE[sensors]
    assert report["ending"] == "distance" and report["falls"] == 0


def test_plays_a_run_in_rust_with_the_bits_of_single_ticks():
    leg = Leg.shore(sensors="imu")
    controller = leg.controller()
    assert leg.play(controller, 1234) == 1234 and leg.seq == 1234
    leg.play(controller)
    assert leg.play(controller) == 0 and leg.ending == "distance"
    assert leg.finish()["state_hash"] == SHORE["imu"]


def test_faults_of_link_and_sensors_act_as_in_the_program(sim_host):
    faults = ["drop=0.1", "delay=2", "noise=0.01,field=vx", "mass=1.1"]
    options = [word for fault in faults for word in ("--fault", fault)]
    run = ["--medium", "water", "--duration", 4, "--seed", 7, "--set-point", 0.2]
    expected = json.loads(sim_host("run", "--json", "--in-process", *run, *options))
    for by_tick in [True, False]:
        pairs = [[pair.split("=") for pair in fault.split(",")] for fault in faults]
        leg = Leg(medium="water", duration_s=4, seed=7, set_point_m_s=0.2, fault=list(map(dict, pairs)))
        controller = leg.controller()
        missing = 0
        if by_tick:
            while leg.ending is None:
                missing += leg.sample is None
                leg.step(controller.tick(leg.sample))
            assert missing > 100
        else:
            leg.play(controller)
        report = leg.finish()
        assert report["state_hash"] == expected["state_hash"]
        assert report["faults"] == expected["faults"]


def test_a_setting_that_is_not_known_is_named():
    with pytest.raises(ValueError, match="settings: unknown field `mediun`"):
        Leg(mediun="water")
    with pytest.raises(ValueError, match="rate_hz"):
        Leg(rate_hz=1)
    with pytest.raises(ValueError, match="no-such-file.toml"):
        Leg("no-such-file.toml")


def test_a_run_that_is_over_raises():
    leg = Leg(duration_s=0.01)
    controller = leg.controller()
    leg.play(controller)
    with pytest.raises(ValueError, match=r"the run is over \(duration\)"):
        leg.step(None)
    assert leg.finish()["ticks"] == 10
    with pytest.raises(RuntimeError, match="was finished"):
        leg.step(None)


def test_a_scenario_file_is_completed_by_settings(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text('medium = "water"\nduration_s = 1.0\nrate_hz = 500\n')
    leg = Leg(path, duration_s=0.5)
    assert leg.play(leg.controller()) == 250


def test_the_set_point_can_be_replaced():
    leg = Leg(medium="water", duration_s=1)
    leg.override_set_point(0.4)
    assert leg.sample.set_point_m_s == pytest.approx(0.4)
    leg.override_set_point(None)
    assert leg.sample.set_point_m_s == 0
    with pytest.raises(ValueError, match="set-point"):
        leg.override_set_point(float("nan"))


def test_a_stranger_plays_the_leg():
    leg = Leg(medium="water", duration_s=3)
    theirs, ours = leg.controller(), leg.controller()
    while leg.ending is None:
        sample = leg.sample
        copy = Sample(
            sample.seq,
            sample.t_ns,
            run_id=sample.run_id,
            set_point_m_s=sample.set_point_m_s,
            vx_m_s=sample.vx_m_s,
            y_m=sample.y_m,
            vy_m_s=sample.vy_m_s,
            contact=sample.contact,
            leg_length_m=sample.leg_length_m,
        )
        assert copy == sample and bytes(copy) == bytes(sample)
        command = theirs.tick(copy)
        assert command == ours.tick(sample)
        leg.step(command)
    assert theirs.counts["rejected"] == 0 and command.apexes > 1


def test_a_stranger_plays_the_controller():
    leg = Leg(medium="water", duration_s=1)
    while leg.ending is None:
        leg.step(Command(leg.sample, 1.6, 0.0, 0.0))
    report = leg.finish()
    assert report["safe_ticks"] == 0 and report["held_ticks"] == 0


def test_messages_are_their_bytes():
    sample = Leg(medium="water").sample
    assert len(bytes(sample)) == 96
    assert pickle.loads(pickle.dumps(sample)) == sample
    command = Controller().tick(sample)
    assert len(bytes(command)) == 64
    assert pickle.loads(pickle.dumps(command)) == command
    with pytest.raises(ValueError, match="a sample of 3 bytes; it has 96"):
        Sample.from_bytes(b"abc")


def test_a_missing_sample_counts_and_leads_to_the_safe_state():
    controller = Controller()
    for _ in range(20):
        command = controller.tick(None)
    assert command.is_safe and controller.counts["missing"] == 20


def test_settings_of_the_controller_are_checked():
    with pytest.raises(ValueError, match="control rate 3 Hz"):
        Controller(rate_hz=3)
    with pytest.raises(ValueError, match="choose 'readings', 'state' or 'inertial'"):
        Controller(estimator="kalman")
    with pytest.raises(ValueError, match="this estimator knows velocity, height, leg-length"):
        Controller(estimator="state", noise={"hight": 1})
    with pytest.raises(ValueError, match="stale_limit_ms"):
        Controller(stale_limit_ms=0)


def test_the_estimator_tells_what_it_holds():
    leg = Leg.shore(sensors="imu")
    controller = leg.controller()
    assert controller.estimate is None
    leg.play(controller, 5000)
    estimate = controller.estimate
    assert estimate["vx_m_s"] == pytest.approx(leg.state[1], abs=0.1)
    assert estimate["density_ratio"] == pytest.approx(1, abs=0.1)
    assert Leg(medium="water").controller().estimate is None


def test_a_policy_is_swapped_at_an_apex_and_lives_as_long_as_the_law():
    leg = Leg(medium="water", duration_s=10)
    controller = leg.controller()
    leg.play(controller, 2000)
    for _ in range(3):
        controller.swap(Policy.from_bytes(bytes(Policy())))
    assert controller.swap_is_pending
    leg.play(controller)
    assert not controller.swap_is_pending and controller.policy_name == Policy().name


def test_a_second_thread_is_told_that_the_leg_is_in_use():
    leg = Leg(medium="water", duration_s=600)
    controller = leg.controller()
    player = threading.Thread(target=leg.play, args=(controller, 300_000))
    player.start()
    refused = 0
    while player.is_alive():
        try:
            leg.t_s
        except RuntimeError as error:
            assert "another thread" in str(error)
            refused += 1
    player.join()
    assert refused > 0 and leg.seq == 300_000


def test_has_all_that_it_exports():
    assert all(hasattr(spring_leg, name) for name in spring_leg.__all__)
