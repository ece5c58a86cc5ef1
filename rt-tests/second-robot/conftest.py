"""The second robot needs a network of its own, which rt-tests/udp/run.sh makes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import CLIENT

sys.path.insert(0, str(CLIENT))


def pytest_collection_modifyitems(items):
    network = os.environ.get("TORQUED_OWN_NETWORK", "no: run rt-tests/udp/run.sh")
    if network != "yes":
        for item in items:
            item.add_marker(pytest.mark.skip(reason=f"network of its own: {network}"))


@pytest.fixture(scope="session")
def robot_program(tmp_path_factory):
    """The robot, compiled."""
    program = tmp_path_factory.mktemp("second-robot") / "robot"
    sources = sorted((Path(__file__).parent / "robot").glob("*.c"))
    subprocess.run(["gcc", "-O2", "-Wall", "-Wextra", "-Werror", "-o", program, *sources, "-lm"], check=True)
    return program
