"""Trains an actor 3-50-50-2 with Stable-Baselines3 and exports it.

    python train_sb3.py --trainer target/release/trainer --steps 30000 --out sb3

writes sb3.safetensors (the actor's state dict) and sb3.onnx (its graph).
"""

import argparse
import time

import numpy as np
import torch
from gymnasium.utils.env_checker import check_env
from safetensors.torch import save_file
from stable_baselines3 import TD3
from stable_baselines3.common.noise import NormalActionNoise

from hopper_env import HopperEnv


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trainer", default="trainer", help="the trainer program")
    parser.add_argument("--steps", type=int, default=30_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="sb3")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    check_env(HopperEnv(arguments.trainer), skip_render_check=True)
    env = HopperEnv(arguments.trainer, seed=arguments.seed)
    model = TD3(
        "MlpPolicy",
        env,
        learning_rate=1e-3,
        buffer_size=arguments.steps,
        learning_starts=1_000,
        batch_size=64,
        gamma=0.6,
        action_noise=NormalActionNoise(np.zeros(2), 0.1 * np.ones(2)),
        policy_kwargs={"net_arch": {"pi": [50, 50], "qf": [100, 100]}},
        seed=arguments.seed,
        device="cpu",
    )
    began = time.monotonic()
    model.learn(arguments.steps)
    print(f"{arguments.steps} steps in {time.monotonic() - began:.0f} s")
    # The actor has features (a Flatten) and mu, an nn.Sequential that ends with Tanh.
    actor = model.policy.actor
    save_file(actor.state_dict(), f"{arguments.out}.safetensors")
    torch.onnx.export(
        actor.mu,
        (torch.zeros(1, 3),),
        f"{arguments.out}.onnx",
        input_names=["observation"],
        output_names=["action"],
        dynamic_shapes=[{0: torch.export.Dim("batch")}],
    )


if __name__ == "__main__":
    main()
