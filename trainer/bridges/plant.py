"""The program `trainer env` as an object. Needs Python's standard library only."""

import math
import os
import subprocess


class Plant:
    """The trainer's plant, hop by hop.

    An exception between a request and its answer, such as a KeyboardInterrupt, does not bring
    requests and answers out of step: the interrupted request is carried out once, and the next
    one gets its own answer. A plant that has ended is started again by the next request, with
    its seed.
    """

    def __init__(self, trainer="trainer", preset="robust", seed=0):
        self.command = [trainer, "env", "--preset", preset, "--seed"]
        self.seed = seed
        self.link = None

    def restart(self, seed):
        """Starts anew with a seed, at the next request."""
        self.close()
        self.seed = seed

    def reset(self):
        """Begins an episode; returns vx in m/s, y in m and the density ratio."""
        return tuple(float(word) for word in self.ask("reset"))

    def step(self, touchdown_angle_rad, elongation_speed_m_s):
        """Hops once; returns (vx, y, density ratio), the reward, and `no`, `fall` or `time`.

        Raises a ValueError for an action that is not two finite numbers, and a RuntimeError
        outside an episode. Neither changes anything.
        """
        action = float(touchdown_angle_rad), float(elongation_speed_m_s)
        if not all(map(math.isfinite, action)):
            raise ValueError(f"the action {action} holds what is not a finite number")
        *numbers, ended = self.ask(f"step {action[0]!r} {action[1]!r}")
        vx, y, rho, reward = (float(number) for number in numbers)
        return (vx, y, rho), reward, ended

    def asked(self):
        """Returns the number of requests since the last start that were or will be carried out."""
        return 0 if self.link is None else self.link.asked()

    def close(self):
        """Ends the plant. The next request starts it again."""
        link, self.link = self.link, None
        if link is not None:
            link.close()

    def ask(self, request):
        if self.link is None:
            self.link = Link([*self.command, str(self.seed)])
        try:
            answer = self.link.ask(request)
        except EOFError:
            link = self.link
            self.close()
            raise RuntimeError(f"the plant ended at '{request}', status {link.process.returncode}") from None
        if answer[0] == "error":
            raise RuntimeError(" ".join(answer[1:]))
        return answer


class Link:
    """A running plant, and its numbered requests."""

    def __init__(self, command):
        # In a session of its own: Ctrl-C at the terminal interrupts Python alone.
        pipe = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "bufsize": 0}
        self.process = subprocess.Popen(command, start_new_session=True, **pipe)
        # Number of the last request that was answered, and the one that is not: number, text.
        self.done = 0
        self.pending = None
        self.received = b""

    def asked(self):
        return self.done if self.pending is None else self.pending[0]

    def ask(self, request):
        """Sends a request; returns the words of its answer. Raises EOFError if the plant ends."""
        self.settle()
        # From here on the request counts, whatever interrupts.
        self.pending = self.done + 1, request
        return self.settle()

    def settle(self):
        """Completes the pending request, if there is one; returns the words of its answer.

        The plant repeats its answer to a number that it knows, so sending again does no harm.
        """
        if self.pending is None:
            return None
        number, request = self.pending
        try:
            # One write of less than PIPE_BUF bytes is done whole or not at all.
            os.write(self.process.stdin.fileno(), f"{number} {request}\n".encode())
        except BrokenPipeError:
            raise EOFError from None
        answer = self.answer(number)
        self.done = number
        self.pending = None
        return answer

    def answer(self, number):
        """Returns the words of the answer with this number."""
        while True:
            while b"\n" not in self.received:
                # What an interrupt loses here is sent again.
                more = os.read(self.process.stdout.fileno(), 65536)
                if not more:
                    raise EOFError
                self.received += more
            line, _, self.received = self.received.partition(b"\n")
            words = line.decode().split()
            # The answer to a request that was sent again comes twice.
            if words and words[0] == str(number):
                return words[1:]

    def close(self):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()
