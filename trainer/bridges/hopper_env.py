"""The hopper as a Gymnasium environment, with the trainer's plant, starts and rewards.

One step is one hop, from apex to apex. The program `trainer` computes the plant;
`trainer env --help` documents its protocol.
"""

import subprocess

import gymnasium
import numpy as np

# Range of the actions: touchdown angle in rad, elongation speed in m/s.
LOW = np.array([np.pi / 10, 0], np.float32)
HIGH = np.array([np.pi / 1.2, 2], np.float32)
# The network's input is (observation - OFFSET) * SCALE, as in the preset `robust`.
OFFSET = np.array([0, 2.5, 0.5], np.float32)
SCALE = np.array([1 / 3, 0.4, 2], np.float32)


class HopperEnv(gymnasium.Env):
    """Observations are scaled apexes; actions are in rad and m/s."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = gymnasium.spaces.Box(LOW, HIGH)

    def __init__(self, trainer="trainer", preset="robust", seed=0):
        self.command = [trainer, "env", "--preset", preset, "--seed"]
        self.plant = None
        self.begin(seed)

    def begin(self, seed):
        self.close()
        pipe = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.plant = subprocess.Popen([*self.command, str(seed)], text=True, bufsize=1, **pipe)

    def request(self, line):
        self.plant.stdin.write(line + "\n")
        reply = self.plant.stdout.readline().split()
        if not reply:
            raise RuntimeError(f"the plant ended at '{line}', status {self.plant.wait()}")
        observation = (np.array(reply[:3], np.float32) - OFFSET) * SCALE
        return observation, reply[3:]

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        if seed is not None:
            self.begin(seed)
        observation, _ = self.request("reset")
        return observation, {}

    def step(self, action):
        touchdown_angle_rad, elongation_speed_m_s = (float(x) for x in action)
        observation, (reward, ended) = self.request(f"step {touchdown_angle_rad!r} {elongation_speed_m_s!r}")
        return observation, float(reward), ended == "fall", ended == "time", {}

    def close(self):
        if self.plant is not None:
            self.plant.stdin.close()
            self.plant.wait()
            self.plant.stdout.close()
            self.plant = None
