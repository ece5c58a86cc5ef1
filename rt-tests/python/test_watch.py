"""`torquectl watch` in a terminal: its picture as a terminal emulator of other people shows it."""

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import time

import pyte
import pytest
from processes import BINARIES, LEG, daemon

pytestmark = pytest.mark.real_time

COLUMNS, LINES = 150, 30


class Terminal:
    """torquectl watch on a terminal of its own."""

    def __init__(self, *options):
        self.screen = pyte.Screen(COLUMNS, LINES)
        self.stream = pyte.ByteStream(self.screen)
        ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
        self.before = termios.tcgetattr(theirs)
        self.ours, self.theirs = ours, theirs
        self.process = subprocess.Popen(
            [BINARIES / "torquectl", "watch", *options],
            stdin=theirs, stdout=theirs, stderr=theirs, env=os.environ | {"TERM": "xterm-256color"},
        )  # fmt: skip

    def read(self, seconds):
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            if select.select([self.ours], [], [], left)[0]:
                self.stream.feed(os.read(self.ours, 65536))
        return self.screen.display

    def wait_for(self, condition, seconds=30):
        until = time.monotonic() + seconds
        while not condition(lines := self.read(0.2)):
            assert time.monotonic() < until, "\n".join(lines)
        return lines

    def press(self, keys):
        os.write(self.ours, keys.encode())

    def end(self):
        code = self.process.wait(timeout=30)
        # The terminal is as it was, for the shell that goes on.
        assert termios.tcgetattr(self.theirs) == self.before
        os.close(self.ours)
        os.close(self.theirs)
        return code


@pytest.fixture
def leg(tmp_path, monkeypatch):
    monkeypatch.setenv("TORQUED_RUN_DIR", str(tmp_path))
    with daemon(LEG, "--simulate"):
        yield


def names(lines):
    known = ["hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll"]
    return [line.split()[0] for line in lines if line.split() and line.split()[0] in known]


def test_joints_are_shown_sorted_and_filtered_and_the_terminal_is_left_as_it_was(leg):
    terminal = Terminal()
    lines = terminal.wait_for(lambda lines: len(names(lines)) == 6 and any("▁" in line for line in lines))
    assert names(lines)[0] == "hip_yaw" and "leg" in lines[0]
    assert any("±" in line and "%" in line for line in lines if line.startswith("knee")), lines
    terminal.press("s")
    terminal.wait_for(lambda lines: names(lines) == sorted(names(lines)) and "by name" in lines[-1])
    terminal.press("/ankle\r")
    terminal.wait_for(lambda lines: names(lines) == ["ankle_pitch", "ankle_roll"])
    terminal.press(" ")
    held = terminal.wait_for(lambda lines: "HELD" in lines[0])
    cycles = held[0].split("cycles ")[1].split(",")[0]
    assert terminal.read(0.5)[0].split("cycles ")[1].split(",")[0] == cycles
    terminal.press("q")
    assert terminal.end() == 0


def test_a_signal_ends_it_and_leaves_the_terminal_as_it_was(leg):
    terminal = Terminal()
    terminal.wait_for(lambda lines: len(names(lines)) == 6)
    terminal.process.send_signal(signal.SIGTERM)
    assert terminal.end() == 0


def test_into_a_pipe_it_prints_a_table(leg):
    printed = subprocess.run([BINARIES / "torquectl", "watch", "--once"], capture_output=True, text=True, timeout=30)
    assert printed.returncode == 0 and "\x1b" not in printed.stdout and "knee" in printed.stdout
