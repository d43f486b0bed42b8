"""Compares a leg in MuJoCo with the product's own plant, under the very control law.

    python study.py [--hops 300] [--only foot|friction|hip|step] [--csv FILE]

Prints, for every leg, medium and set-point: hops survived, mean velocity and height of the last
20 apexes in MuJoCo and in the product's plant with the same foot, damping and friction, and the
largest friction that MuJoCo's ground gave. Needs mujoco, numpy and the package `spring_leg`.
"""

import argparse
import csv
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import spring_leg

from mujoco_leg import MujocoLeg, Options

MEDIA = (0.0, 0.5, 1.0)
SET_POINTS = (0.0, 0.5, 1.0)
USUAL = Options()
STUDIES = {
    "foot": [replace(USUAL, foot_kg=m, damping_n_s_m=d) for m in (0.5, 1, 2, 4) for d in (20, 200)],
    "friction": [replace(USUAL, friction=f) for f in (0.4, 0.6, 0.8, 1.2)],
    "hip": [replace(USUAL, hip_hz=f) for f in (2, 5, 20)],
    "step": [replace(USUAL, step_s=s) for s in (0.0001, 0.00025, 0.001)]
    + [replace(USUAL, rate_hz=r) for r in (250, 500, 2000)],
}


class PlantLeg:
    """The product's plant with the interface of `MujocoLeg`."""

    def __init__(self, options):
        o = self.options = options
        plant = spring_leg.Plant(density_ratio=o.density_ratio)
        (x, y), vx = o.start_m, o.start_m_s
        self.leg = plant.ticks(
            np.array([x, vx, y, 0.0]),
            damping_n_s_m=o.damping_n_s_m,
            foot_mass_kg=o.foot_kg,
            friction=o.friction,
        )
        self.apexes = []

    def reading(self):
        _, vx, y, vy = self.leg.states
        return {
            "vx_m_s": vx,
            "y_m": y,
            "vy_m_s": vy,
            "contact": bool(self.leg.phases[0]),
            "leg_length_m": self.leg.leg_lengths_m[0],
        }

    @property
    def has_fallen(self):
        return not self.leg.states[2] > 0

    def tick(self, command):
        before = self.leg.states[3]
        self.leg.step(1 / self.options.rate_hz, np.array(command))
        _, vx, y, after = self.leg.states
        if before > 0 >= after:
            self.apexes.append((vx, y))


def hop(leg, set_point, hops):
    """Hops under the control law; returns hops, mean apex velocity and height of the last 20."""
    rate = leg.options.rate_hz
    controller = spring_leg.Controller(rate_hz=rate)
    seq = 0
    while len(leg.apexes) < hops and not leg.has_fallen and seq < 20 * hops * rate:
        sample = spring_leg.Sample(seq, seq * (10**9 // rate), set_point_m_s=set_point, **leg.reading())
        c = controller.tick(sample)
        leg.tick((c.leg_angle_rad, c.elongation_m, c.elongation_rate_m_s))
        seq += 1
    vx, y = np.mean(leg.apexes[-20:], axis=0) if leg.apexes else (math.nan, math.nan)
    return len(leg.apexes), float(vx), float(y)


def case(arguments):
    options, set_point, hops = arguments
    mujoco = MujocoLeg(options)
    return hop(mujoco, set_point, hops), mujoco.needed_friction, hop(PlantLeg(options), set_point, hops)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hops", type=int, default=300)
    parser.add_argument("--only", choices=STUDIES, action="append")
    parser.add_argument("--csv", help="file to write")
    given = parser.parse_args()
    options = [o for name in given.only or STUDIES for o in STUDIES[name]]
    cases = [(replace(o, density_ratio=m), v, given.hops) for o in options for m in MEDIA for v in SET_POINTS]
    columns = "foot damping friction hip step rate density set-point"
    columns += " hops vx y friction-used plant-hops plant-vx plant-y"
    rows = []
    print("  foot damping friction   hip  step  rate | rho set-point | MuJoCo hops     vx      y  needed | plant hops     vx      y")
    with ProcessPoolExecutor() as pool:
        for (o, v, _), (ours, needed, plant) in zip(cases, pool.map(case, cases)):
            rows.append(
                [o.foot_kg, o.damping_n_s_m, o.friction, o.hip_hz, o.step_s, o.rate_hz, o.density_ratio, v]
                + [*ours, needed, *plant]
            )
            print(
                f"{o.foot_kg:4} kg {o.damping_n_s_m:7} {o.friction:8} {o.hip_hz:2} Hz {1e3 * o.step_s:5} {o.rate_hz:5} | "
                f"{o.density_ratio:3} {v:9} | {ours[0]:11} {ours[1]:6.3f} {ours[2]:6.3f} {needed:7.2f} | "
                f"{plant[0]:10} {plant[1]:6.3f} {plant[2]:6.3f}",
                flush=True,
            )
    if given.csv:
        with open(given.csv, "w", newline="") as file:
            csv.writer(file).writerows([columns.split(), *rows])
    survived = sum(row[8] >= given.hops for row in rows)
    tracked = sum(abs(row[9] - row[7]) <= 0.05 * max(row[7], 1) and row[8] >= given.hops for row in rows)
    print(f"{len(rows)} legs: {survived} hop {given.hops} times, {tracked} of them within 5 % of the set-point")
    return 0


if __name__ == "__main__":
    sys.exit(main())
