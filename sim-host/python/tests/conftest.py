"""Warnings are errors, and the program `sim-host` to compare with."""

import os
import subprocess

import pytest


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
