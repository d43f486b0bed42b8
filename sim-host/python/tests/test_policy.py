"""Policies: reading, checks, actions."""

import json
import pickle

import numpy as np
import pytest

from spring_leg import Leg, Policy


def test_the_shipped_policy_has_its_manifest():
    policy = Policy()
    manifest = policy.manifest
    assert policy.name == manifest["name"] == "robust"
    assert manifest["widths"] == [3, 50, 50, 2]
    assert manifest["provenance"]["seed"] == 5
    assert set(manifest) == {
        "name", "widths", "observation", "action", "leg", "media", "provenance", "gains"
    }  # fmt: skip
    json.dumps(manifest)


def test_computes_the_actions_that_the_controller_takes():
    leg = Leg(medium="water", duration_s=20, set_point_m_s=0.3)
    controller, policy = leg.controller(), Policy()
    seen, apexes = 0, 0
    rest_m = policy.manifest["leg"]["rest_length_m"]
    while leg.ending is None:
        command = controller.tick(leg.sample)
        if command.apexes != apexes:
            apexes = command.apexes
            observed = np.float32(command.apex_vx_m_s) - np.float32(command.velocity_offset_m_s)
            action = policy.infer([observed, command.apex_y_m, command.density_ratio])
            seen += 1
        elif apexes and leg.sample.leg_length_m == pytest.approx(rest_m):
            assert command.leg_angle_rad == action[0]
        leg.step(command)
    assert seen > 4


def test_infers_batches_as_single_observations():
    policy = Policy()
    observations = np.random.default_rng(1).uniform([-9, 1, 0], [9, 9, 1], (1000, 3))
    actions = policy.infer(observations)
    assert actions.shape == (1000, 2) and actions.dtype == np.float32
    assert np.array_equal(actions, [policy.infer(one) for one in observations])
    assert policy.infer(np.empty((0, 3))).shape == (0, 2)
    strided = policy.infer(np.asfortranarray(observations)[::3])
    assert np.array_equal(strided, actions[::3])


@pytest.mark.parametrize("bad", [[1, 2], [[1, 2]], 3, [[[1, 2, 3]]]])
def test_refuses_observations_of_another_shape(bad):
    with pytest.raises(ValueError, match=r"observations has the shape .*\(3,\) or \(rows, 3\)"):
        Policy().infer(bad)


def test_reads_and_refuses_files(tmp_path):
    policy = Policy()
    path = tmp_path / "policy.bin"
    path.write_bytes(bytes(policy))
    assert Policy(path) == policy and Policy(str(path)) == policy
    broken = bytearray(bytes(policy))
    broken[-100] ^= 1
    path.write_bytes(broken)
    with pytest.raises(ValueError, match="policy.bin is not a valid policy"):
        Policy(path)
    with pytest.raises(OSError, match="cannot read the policy"):
        Policy(tmp_path / "missing.bin")
    with pytest.raises(ValueError, match="the blob is not a valid policy"):
        Policy.from_bytes(b"")


def test_is_pickled_and_compared_by_its_bytes():
    policy = Policy()
    other = pickle.loads(pickle.dumps(policy))
    assert other == policy and hash(other) == hash(policy) and other is not policy
    assert f"{policy.crc32:08x}" in repr(policy)
