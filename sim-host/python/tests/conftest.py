"""Warnings are errors, and the program `sim-host` to compare with."""

import os
import signal
import subprocess
import threading

import pytest

# Windows are drawn, but not shown: tests open none on a screen, and load no graphics driver.
os.environ["SDL_VIDEODRIVER"] = "dummy"


def pytest_collection_modifyitems(items):
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("error"))


@pytest.fixture
def sim_host():
    """Runs the program that LEG_SIM_HOST names; `cargo xtask python` builds it."""
    program = os.environ.get("LEG_SIM_HOST")
    if program is None:
        pytest.skip("LEG_SIM_HOST names no sim-host")

    def run(*arguments):
        command = [program, *map(str, arguments)]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    return run


@pytest.fixture
def interrupt():
    """Sends SIGINT to this process in so many seconds.

    It raises KeyboardInterrupt even if the process inherited that it ignores the signal, as one
    does that a shell starts in the background.
    """
    inherited = signal.signal(signal.SIGINT, signal.default_int_handler)

    def send_in(seconds):
        threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT)).start()

    yield send_in
    signal.signal(signal.SIGINT, inherited)
