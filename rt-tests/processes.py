"""torqued, torqued-sim and clients as processes of their own: start, wait, read the report."""

import json
import os
import queue
import re
import signal
import subprocess
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BINARIES = Path(os.environ.get("TORQUED_BINARIES", ROOT / "target" / "debug"))
PYTHON = ROOT / ".venv" / "bin" / "python"
CLIENT = ROOT / "client" / "python"
# State directory of the tests: the user's own offsets are left alone.
STATE = tempfile.TemporaryDirectory(prefix="torqued-state-")
LEG = ROOT / "config" / "leg" / "robot.toml"


class Process:
    """A running command. Its lines are kept, and can be waited for as they come."""

    def __init__(self, *command, stdin=None):
        self.command = [str(part) for part in command]
        self.lines = []
        self._new = queue.Queue()
        self._popen = subprocess.Popen(
            self.command,
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": str(CLIENT), "XDG_STATE_HOME": STATE.name},
            text=True,
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self._stdout = []
        self._readers = [
            threading.Thread(target=self._read, args=args, daemon=True)
            for args in ((self._popen.stdout, self._stdout), (self._popen.stderr, None))
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, stream, copy):
        for line in stream:
            self.lines.append(line)
            if copy is not None:
                copy.append(line)
            self._new.put(line)
        self._new.put(None)

    def _fail(self, what):
        return AssertionError(f"{what}\n$ {' '.join(self.command)}\n{self.output()}")

    def output(self):
        """All lines printed so far, both streams."""
        return "".join(self.lines)

    def wait_for(self, pattern, limit_s=60.0):
        """The match of the pattern in the first new line that has it."""
        until = time.monotonic() + limit_s
        ended = 0
        while ended < 2:
            try:
                line = self._new.get(timeout=max(0.0, until - time.monotonic()))
            except queue.Empty:
                raise self._fail(f"no '{pattern}' within {limit_s} s") from None
            if line is None:
                ended += 1
            elif match := re.search(pattern, line):
                return match
        raise self._fail(f"ended without '{pattern}'")

    def send(self, number):
        """Sends a signal."""
        self._popen.send_signal(number)

    def wait(self, limit_s=120.0):
        """The exit code."""
        try:
            code = self._popen.wait(limit_s)
        except subprocess.TimeoutExpired:
            self.kill()
            raise self._fail(f"still running after {limit_s} s") from None
        for reader in self._readers:
            reader.join()
        return code

    def report(self, limit_s=120.0, code=0):
        """Waits for the end with that exit code; returns the JSON document of the last line."""
        if self.wait(limit_s) != code:
            raise self._fail(f"exit code {self._popen.returncode}, not {code}")
        return json.loads(self._stdout[-1])

    def terminate(self, limit_s=30.0, code=0):
        """Ends it as systemd does; returns its report."""
        self.send(signal.SIGTERM)
        return self.report(limit_s, code)

    def runs(self):
        """Whether it has not ended."""
        return self._popen.poll() is None

    def kill(self):
        """Ends it, whatever its state."""
        self._popen.kill()
        self._popen.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()


def example(name):
    """An example program; its path. It is built as all tests are: with a crate's features alone, all that it
    depends on would be built once more."""
    build = ["cargo", "build", "-q", "--workspace", "--features", "rt-tests/vcan", "--example", name]
    build += ["--message-format", "json"]
    artifacts = subprocess.run(build, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    found = (json.loads(line) for line in artifacts.splitlines())
    return next(one["executable"] for one in found if one.get("executable") and one["target"]["name"] == name)


def json_program(path):
    """A function that passes a request to a program and returns its answer, both JSON."""

    def call(**request):
        answer = subprocess.run([path], input=json.dumps(request), capture_output=True, text=True)
        assert answer.returncode == 0, answer.stderr
        return json.loads(answer.stdout)

    return call


def simulator(config, *options):
    """torqued-sim, waiting for SYNC frames."""
    process = Process(BINARIES / "torqued-sim", config, "--json", *options)
    process.wait_for("ready")
    return process


def forget_faults():
    """Removes the faults that earlier daemons have left latched."""
    for path in Path(STATE.name).glob("torqued/*/fault.toml"):
        path.unlink()


def daemon(config, *options):
    """torqued run without a fault of an earlier run, from its first cycle on."""
    forget_faults()
    process = Process(BINARIES / "torqued", "run", config, "--json", *options)
    process.wait_for("running")
    return process


def derived_config(folder, changes, config=LEG):
    """A copy of a config with words replaced: {old: new}; each old one must occur."""
    text = config.read_text()
    for old, new in changes.items():
        assert old in text, f"{config} has no {old!r}"
        text = text.replace(old, new)
    # Relative paths refer to the folder of the original.
    absolute = lambda text: re.sub(r'"(\.\./[^"]*)"', lambda m: f'"{(config.parent / m[1]).resolve()}"', text)
    path = folder / "robot.toml"
    path.write_text(absolute(text))
    # Its sim.toml, beside it, has the parameters of the simulated robot.
    (folder / "sim.toml").write_text(absolute((config.parent / "sim.toml").read_text()))
    return path


def kernel_frames(*interfaces):
    """Frames that have passed the interfaces, as the kernel counts them."""
    counters = (Path("/sys/class/net") / i / "statistics" / "rx_packets" for i in interfaces)
    return sum(int(path.read_text()) for path in counters)
