"""docs/bring-up.md from its first command to its last, on the simulated robot: each command ends well, and prints
what the page shows, but for the numbers. Motions are shorter than on the page."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.real_time

ROOT = Path(__file__).resolve().parents[2]
BINARIES = Path(os.environ.get("TORQUECTL", ROOT / "target/debug/torquectl")).resolve().parent
# What the page lets run for minutes.
SHORTER = {"--seconds 120": "--seconds 32"}
PLAN = """config = "robot.toml"
pose = { hip_pitch = -20, knee = 40, ankle_pitch = -20 }
[[part]]
kind = "growing_sine"
joints = ["knee"]
amplitude_deg = 4
frequency_hz = 0.5
duration_s = 4
"""
NUMBER = re.compile(r"[-+]?\d[\d.:TZ-]*(e[-+]?\d+)?")


def commands():
    """(command, lines shown) of every block, in their order."""
    found = []
    for language, block in re.findall(r"```(\w*)\n(.*?)```", (ROOT / "docs/bring-up.md").read_text(), re.S):
        for line in block.splitlines():
            if language == "sh":
                found.append((line.split("  #")[0].strip(), []))
            elif line.startswith("$ "):
                found.append((line[2:], []))
            elif found:
                found[-1][1].append(line)
    return found


def form(line):
    """A line without its numbers and the width of its columns; a table's last column may be empty."""
    line = NUMBER.sub("#", line)
    line = re.sub(r"\s+", " ", line).strip()
    return re.sub(r"(#|calibrated) [a-z ,]+$", r"\1", line)


@pytest.fixture
def place(tmp_path):
    for part in ("config/leg", "robot-models/leg"):
        shutil.copytree(ROOT / part, tmp_path / part)
    (tmp_path / "config/leg/excite.toml").write_text(PLAN)
    return tmp_path


def test_every_command_of_the_page_runs_and_prints_what_it_shows(place):
    environment = {
        **os.environ,
        "PATH": f"{BINARIES}:{os.environ['PATH']}",
        "TORQUED_RUN_DIR": str(place / "run"),
        "STATE_DIRECTORY": str(place / "state"),
    }
    for folder in ("run", "state"):
        (place / folder).mkdir()
    daemon, ran = None, []
    try:
        for command, shown in commands():
            for long, short in SHORTER.items():
                command = command.replace(long, short)
            if command.startswith("torqued run"):
                arguments = [*shlex.split(command), "--simulate"]
                daemon = subprocess.Popen(arguments, cwd=place, env=environment, stdout=subprocess.DEVNULL,
                                          stderr=subprocess.PIPE, text=True)
                wait_for(lambda: answers(place, environment, daemon))
                ran.append(command)
                continue
            limit_s = 240
            done = subprocess.run(
                shlex.split(command), cwd=place, env=environment, capture_output=True, text=True, timeout=limit_s
            )
            # The demo's exit code says how good its estimates are.
            allowed = (0, 1) if command.startswith("torqued demo") else (0,)
            assert done.returncode in allowed, f"{command}\n{done.stdout}{done.stderr}"
            printed = [form(line) for line in done.stdout.splitlines()]
            for line in filter(lambda line: line.strip() not in ("", "..."), shown):
                assert form(line) in printed, f"{command}: not printed: {line}\n{done.stdout}"
            ran.append(command)
    finally:
        if daemon:
            daemon.send_signal(signal.SIGINT)
            daemon.communicate(timeout=20)
    assert len(ran) >= 10 and any("calibrate commit" in command for command in ran)
    text = (place / "config/leg/robot.toml").read_text()
    assert text.count("calibration = ") == 6 and (place / "plan.svg").is_file()


def answers(place, environment, daemon):
    assert daemon.poll() is None, daemon.stderr.read()
    done = subprocess.run(["torquectl", "state"], cwd=place, env=environment, capture_output=True, text=True)
    return done.returncode == 0 and "boot" not in done.stdout


def wait_for(condition, limit_s=60):
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.2)
