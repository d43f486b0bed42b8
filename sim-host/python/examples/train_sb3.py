"""Trains a hopper with Stable-Baselines3, PPO or TD3, and saves its actor for `trainer import`.

    python train_sb3.py ppo
    trainer import --safetensors ppo.safetensors OPTIONS --out ppo.bin

It prints OPTIONS, which state what the file cannot: activations and scalings.
"""

import argparse
import time

import numpy as np
import torch
from safetensors.torch import save_file
from stable_baselines3 import PPO, TD3
from stable_baselines3.common.noise import NormalActionNoise

from spring_leg.sb3 import HopperVecEnv


# The environment scales observations, and spreads actions from -1 to 1 over the leg's bounds: of a
# tanh the trainer assumes that, of an output without one it must be said.
SCALING = "--observation-offset 0,2.5,0.5 --observation-scale 0.33333334,0.4,2"
OPTIONS = {
    "ppo": f"--hidden-activation tanh --output-activation linear {SCALING} "
    "--action-offset 1.4660765,1 --action-scale 1.1519172,1",
    "td3": SCALING,
}


def ppo(seed, steps):
    """Returns the actor of PPO after these steps: SB3's own network, 3-64-64-2 with tanh."""
    model = PPO(
        "MlpPolicy",
        HopperVecEnv(256, seed=seed),
        learning_rate=lambda left: 1e-3 * left + 1e-5,
        n_steps=16,
        batch_size=1024,
        n_epochs=6,
        gamma=0.7,
        gae_lambda=0.9,
        policy_kwargs={"log_std_init": -1.0},
        seed=seed,
        device="cpu",
    )
    model.learn(steps)
    policy = model.policy
    return torch.nn.Sequential(*policy.mlp_extractor.policy_net, policy.action_net)


def td3(seed, steps):
    """Returns the actor of TD3 after these steps: 3-50-50-2 with ReLU, tanh at the end."""
    model = TD3(
        "MlpPolicy",
        HopperVecEnv(64, seed=seed),
        learning_rate=lambda left: 1e-3 * left + 1e-5,
        buffer_size=steps,
        learning_starts=5_000,
        batch_size=256,
        gamma=0.6,
        train_freq=1,
        gradient_steps=16,
        action_noise=NormalActionNoise(np.zeros(2), np.array([0.03, 0.3])),
        policy_kwargs={"net_arch": {"pi": [50, 50], "qf": [100, 100]}},
        seed=seed,
        device="cpu",
    )
    model.learn(steps)
    return model.policy.actor.mu


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("algorithm", choices=["ppo", "td3"])
    parser.add_argument("--steps", type=int, help="hops to train [default: 600,000 or 60,000]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", help="the file to write [default: ppo.safetensors …]")
    arguments = parser.parse_args()
    # More threads are of no use to networks of this size.
    torch.set_num_threads(1)
    train, steps = {"ppo": (ppo, 600_000), "td3": (td3, 60_000)}[arguments.algorithm]
    steps = arguments.steps or steps
    out = arguments.out or f"{arguments.algorithm}.safetensors"
    began = time.monotonic()
    actor = train(arguments.seed, steps)
    print(f"{steps} hops in {time.monotonic() - began:.0f} s")
    # Named 0, 2, 4 by their places, as `nn.Sequential` does.
    save_file({name: tensor.contiguous() for name, tensor in actor.state_dict().items()}, out)
    print(f"{out}: import it with {OPTIONS[arguments.algorithm]}")


if __name__ == "__main__":
    main()
