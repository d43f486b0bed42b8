"""Measures the environments: hops a second in `step`, with actions of the shipped policy."""

import time

import gymnasium
import numpy as np

import spring_leg  # noqa: F401 (registers the environments)
from spring_leg import Policy

STEPS = 3000


def main():
    policy = Policy()
    envs = gymnasium.make_vec("spring_leg/Hopper-v0", num_envs=256)
    single = gymnasium.make("spring_leg/Hopper-v0").unwrapped
    low, high = (single.physical_action([x, x]) for x in (-1, 1))
    # As in the preset `robust`.
    offset, scale = np.float32([0, 2.5, 0.5]), np.float32([1 / 3, 0.4, 2])

    def actions(observations):
        physical = policy.infer(observations / scale + offset)
        return np.clip((2 * physical - low - high) / (high - low), -1, 1)

    observations, _ = envs.reset(seed=1)
    times = []
    for _ in range(STEPS):
        chosen = actions(observations)
        began = time.perf_counter()
        observations, *_ = envs.step(chosen)
        times.append(time.perf_counter() - began)
    fast, median = envs.num_envs / np.quantile(times, [0.1, 0.5])
    print(f"make_vec with 256: {median:,.0f} hops/s (median)")
    print(f"of the fastest tenth: {fast:,.0f} hops/s")

    single.reset(seed=1)
    steps, began = 0, time.perf_counter()
    while steps < 50_000:
        _, _, terminated, truncated, _ = single.step([0, -0.8])
        steps += 1
        if terminated or truncated:
            single.reset()
    print(f"HopperEnv: {steps / (time.perf_counter() - began):,.0f} steps/s")


if __name__ == "__main__":
    main()
