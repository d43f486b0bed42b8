"""The hopper as a Gymnasium environment, with the trainer's plant, starts and rewards.

One step is one hop, from apex to apex. The program `trainer` computes the plant;
`trainer env --help` documents its protocol.
"""

import gymnasium
import numpy as np

from plant import Plant

# Range of the actions: touchdown angle in rad, elongation speed in m/s.
LOW = np.array([np.pi / 10, 0], np.float32)
HIGH = np.array([np.pi / 1.2, 2], np.float32)
# The network's input is (observation - OFFSET) * SCALE, as in the preset `robust`.
OFFSET = np.array([0, 2.5, 0.5], np.float32)
SCALE = np.array([1 / 3, 0.4, 2], np.float32)


class HopperEnv(gymnasium.Env):
    """Observations are scaled apexes; actions are in rad and m/s.

    A step that an exception interrupts, such as a KeyboardInterrupt, has been carried out once
    it was sent; the next answer is that to the next action. A bad action, and a step before the
    first reset or after the end of an episode, raise an error and change nothing.
    """

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = gymnasium.spaces.Box(LOW, HIGH)

    def __init__(self, trainer="trainer", preset="robust", seed=0):
        self.plant = Plant(trainer, preset, seed)

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        if seed is not None:
            self.plant.restart(seed)
        return self.scaled(self.plant.reset()), {}

    def step(self, action):
        touchdown_angle_rad, elongation_speed_m_s = action
        apex, reward, ended = self.plant.step(touchdown_angle_rad, elongation_speed_m_s)
        return self.scaled(apex), reward, ended == "fall", ended == "time", {}

    def scaled(self, apex):
        return (np.array(apex, np.float32) - OFFSET) * SCALE

    def close(self):
        self.plant.close()
