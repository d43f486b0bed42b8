"""Recordings as columns."""

import json
from pathlib import Path

import numpy as np
import pytest

from spring_leg import Leg, Policy, read_recording

OLD = Path(__file__).parents[2] / "tests/recordings/wire-1.mcap"


@pytest.fixture
def recorded(sim_host, tmp_path):
    path = tmp_path / "run.mcap"
    run = ["--medium", "water", "--duration", 3, "--set-point", 0.2, "--sensors", "imu", "--seed", 3]
    report = sim_host("run", "--in-process", "--json", "--record", path, *run)
    return path, json.loads(report)


def test_has_the_samples_states_and_commands_of_the_run(recorded):
    path, report = recorded
    topics = read_recording(path)
    states, samples, commands = topics["/state"], topics["/sample"], topics["/command"]
    assert len(states["x_m"]) == report["ticks"] == 3000
    assert states["x_m"].dtype == np.float64 and samples["set_point_m_s"].dtype == np.float32
    leg = Leg(medium="water", duration_s=3, set_point_m_s=0.2, sensors="imu", seed=3)
    controller = leg.controller()
    for tick in range(3000):
        truth = [states[name][tick] for name in ("x_m", "vx_m_s", "y_m", "vy_m_s")]
        assert np.array_equal(leg.state, truth)
        sample = leg.sample
        assert (samples["sensors.impulse_x"][tick], samples["sensors.impulse_y"][tick]) == sample.impulse
        assert samples["t_ns"][tick] == sample.t_ns and samples["flags"][tick] == sample.flags
        command = controller.tick(sample)
        assert commands["leg_angle_rad"][tick] == np.float32(command.leg_angle_rad)
        leg.step(command)
    assert leg.finish()["state_hash"] == report["state_hash"] == topics["/end"]["state_hash"][0]


def test_has_text_names_and_bytes(recorded):
    topics = read_recording(recorded[0])
    assert set(topics["/state"]["phase"]) == {"flight", "stance"}
    assert {"touchdown", "lift_off"} <= set(topics["/event"]["kind"])
    assert bytes(Policy()) == topics["/policy"]["blob"][0]
    assert topics["/config"]["command_line"][0][1] == "run"
    assert "water" in topics["/config"]["scenario_toml"][0]
    assert topics["/law"]["noise"][0][0].keys() == {"name", "deviation"}
    assert topics["/command"]["is_new"].dtype == bool and topics["/command"]["is_new"].all()


def test_is_a_data_frame_for_each_topic(recorded):
    pandas = pytest.importorskip("pandas")
    frames = read_recording(recorded[0], pandas=True)
    states = frames["/state"]
    assert isinstance(states, pandas.DataFrame) and len(states) == 3000
    assert (states.loc[states.phase == "stance", "foot_y_m"] == 0).all()


def test_reads_a_recording_of_an_earlier_version():
    topics = read_recording(OLD)
    assert len(topics["/sample"]["t_ns"]) == len(topics["/state"]["x_m"]) > 0


def test_reads_a_file_that_was_cut_off_with_a_warning(recorded, tmp_path):
    whole, _ = recorded
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    with pytest.warns(UserWarning, match="cut"):
        topics = read_recording(cut)
    states = read_recording(whole)["/state"]["x_m"]
    read = len(topics["/state"]["x_m"])
    assert 0 < read < len(states) and np.array_equal(topics["/state"]["x_m"], states[:read])


def test_what_is_no_recording_is_refused(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"not at all an MCAP file")
    with pytest.raises(ValueError, match="is not an MCAP file"):
        read_recording(other)
    with pytest.raises(OSError, match="cannot read the recording"):
        read_recording(tmp_path / "missing.mcap")
