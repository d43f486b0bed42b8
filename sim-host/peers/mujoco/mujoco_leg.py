"""The leg in MuJoCo: foot mass, damping, impact, a friction cone, hip servo, and a fluid."""

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

BODY_KG, ADDED_KG, VOLUME_M3 = 80.0, 8.0, 0.0624
# Area times drag coefficient, along x and z.
DRAG_M2 = np.array([0.1925 * 1.05, 0.105 * 1.05])
G_M_S2, WATER_KG_M3 = 9.81, 1000.0
# Of the leg itself, without its foot; also the joint's armature.
HIP_INERTIA_KG_M2 = 0.01
# Ticks without a command until the leg is upright and passive.
STALE_TICKS = 10


@dataclass
class Options:
    """What the study varies."""

    foot_kg: float = 0.5
    damping_n_s_m: float = 20.0
    friction: float = 0.8
    # Natural frequency of the hip's servo.
    hip_hz: float = 10.0
    step_s: float = 0.0005
    rate_hz: int = 1000
    density_ratio: float = 0.0
    start_m: tuple = (0.0, 1.5)
    start_m_s: float = 0.0


class MujocoLeg:
    """A leg that is stepped tick by tick."""

    def __init__(self, options=None):
        self.options = o = options or Options()
        spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name("leg.xml")))
        spec.option.timestep = o.step_s
        spec.geom("foot").mass = o.foot_kg
        spec.geom("foot").friction[0] = spec.geom("ground").friction[0] = o.friction
        spec.joint("spring").damping[0] = o.damping_n_s_m
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.steps = round(1 / (o.rate_hz * o.step_s))
        if abs(self.steps * o.rate_hz * o.step_s - 1) > 1e-9 or self.steps < 1:
            raise ValueError(f"a tick at {o.rate_hz} Hz is no whole number of steps of {o.step_s} s")
        self.data.qpos[:2] = o.start_m
        self.data.qvel[0] = o.start_m_s
        self.apexes, self.slip_m, self.needed_friction = [], 0.0, 0.0
        self.command, self.command_age = (math.pi / 2, 0.0, 0.0), STALE_TICKS
        mujoco.mj_forward(self.model, self.data)

    def sensor(self, name):
        return self.data.sensor(name).data

    def reading(self):
        """Returns what the leg senses, by the names of a sample."""
        (x, _, z), (vx, _, vz) = self.sensor("position"), self.sensor("velocity")
        return {
            "vx_m_s": vx,
            "y_m": z,
            "vy_m_s": vz,
            "contact": bool(self.sensor("touch")[0] > 0),
            "leg_length_m": 1.0 + self.sensor("spring")[0],
        }

    @property
    def has_fallen(self):
        return self.data.qpos[1] <= 0.02 or not np.isfinite(self.data.qpos).all()

    def tick(self, command=None):
        """Plays one tick under the newest command, (angle rad, elongation m, its rate m/s)."""
        if command is not None:
            self.command, self.command_age = command, 0
        angle, elongation, rate = self.command
        if self.command_age >= STALE_TICKS:
            angle, elongation, rate = math.pi / 2, 0.0, 0.0
        d, o = self.data, self.options
        for step in range(self.steps):
            age_s = (self.command_age + step / self.steps) / o.rate_hz
            d.ctrl[0] = min(max(elongation + rate * age_s, 0.0), 0.2)
            d.ctrl[1] = self.hip_torque(angle - math.pi / 2)
            self.fluid()
            vz = d.qvel[1]
            mujoco.mj_step(self.model, d)
            if vz > 0 >= d.qvel[1]:
                self.apexes.append((d.qvel[0], d.qpos[1]))
            self.ground()
        self.command_age += 1

    def hip_torque(self, target):
        """Returns the torque of a critically damped servo; the hip is free while the foot stands."""
        if self.sensor("touch")[0] > 0:
            return 0.0
        q, v = self.data.qpos[2], self.data.qvel[2]
        # The inertia that it turns is that of the foot at the end of the leg.
        inertia = self.options.foot_kg * (0.98 + self.data.qpos[3]) ** 2 + HIP_INERTIA_KG_M2
        w = 2 * math.pi * self.options.hip_hz
        return inertia * (w * w * (target - q) - 2 * w * v)

    def fluid(self):
        """Applies gravity, buoyancy and drag of the plant to the body."""
        d, rho = self.data, WATER_KG_M3 * self.options.density_ratio
        v = d.qvel[:2]
        d.qfrc_applied[:2] = -0.5 * rho * DRAG_M2 * v * np.abs(v)
        # MuJoCo pulls at 88 kg; gravity acts on 80, and buoyancy on the volume.
        d.qfrc_applied[1] += G_M_S2 * (ADDED_KG + rho * VOLUME_M3)

    def ground(self):
        """Notes the friction that a stance needs."""
        force = np.zeros(6)
        for i in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, i, force)
            if force[0] > 50:
                self.needed_friction = max(self.needed_friction, math.hypot(force[1], force[2]) / force[0])


def main():
    """Plays the leg for the program `controller`, in lock-step."""
    import argparse
    import json

    from session import LegSession

    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--domain", default="default")
    parser.add_argument("--set-point", type=float, default=0.0, help="m/s")
    parser.add_argument("--hops", type=int, default=30)
    parser.add_argument("--density", type=float, default=0.0, help="of the medium over that of water, 0 to 1")
    parser.add_argument("--foot", type=float, default=0.5, help="mass of the foot, kg")
    parser.add_argument("--damping", type=float, default=20.0, help="of the spring, N s/m")
    parser.add_argument("--friction", type=float, default=0.8)
    given = parser.parse_args()
    leg = MujocoLeg(
        Options(
            foot_kg=given.foot,
            damping_n_s_m=given.damping,
            friction=given.friction,
            density_ratio=given.density,
        )
    )
    session, seq = LegSession(given.domain, leg.options.rate_hz), 0
    while len(leg.apexes) < given.hops and not leg.has_fallen:
        leg.tick(session.exchange(seq, given.set_point, leg.reading()))
        seq += 1
    session.leave(seq)
    vx, y = np.mean(leg.apexes[-10:], axis=0) if leg.apexes else (math.nan, math.nan)
    print(json.dumps({"ticks": seq, "hops": len(leg.apexes), "fallen": bool(leg.has_fallen), "vx_m_s": vx, "y_m": y}))


if __name__ == "__main__":
    main()
