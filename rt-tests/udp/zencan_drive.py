"""Drives of CiA 402 on the crate `zencan-node`, a third CANopen stack that is not the project's: a program for each
(rt-tests/zencan-drive), whose frames pass from and to the bus here."""

import json
import subprocess
import threading

import can
from processes import ROOT

GROUP, PORT = "239.74.163.2", 43113
SOURCE, TARGET = ROOT / "rt-tests" / "zencan-drive", ROOT / "target" / "zencan-drive"


def built():
    """The drive's program; a minute on one processor the first time."""
    command = ["cargo", "build", "--quiet", "--locked", "--manifest-path", SOURCE / "Cargo.toml", "--target-dir", TARGET]
    subprocess.run(command, check=True, timeout=600)
    return TARGET / "debug" / "zencan-drive"


class Drive:
    """One drive: its program, until `end`. `reported`: what it said last of itself."""

    def __init__(self, program, bus, node, degrees):
        self.reported, self.bus = None, bus
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self._program = subprocess.Popen([program, str(node), str(degrees)], text=True, bufsize=1, **pipes)
        self._began = threading.Event()
        threading.Thread(target=self._read, daemon=True).start()
        assert self._began.wait(10), "the drive's program does not begin"

    def hear(self, line):
        self._program.stdin.write(line)

    def end(self):
        self._program.stdin.close()
        assert self._program.wait(10) == 0, "the drive's program failed"

    def __getattr__(self, name):
        return self.reported[name]

    def value(self, index, sub=0):
        return self.reported[f"{index:04X}:{sub}"]

    @property
    def operational(self):
        return self.nmt == "Operational"

    def _read(self):
        for line in self._program.stdout:
            id_, data = line.split(" ", 1)
            if id_ == "=":
                self.reported = json.loads(data)
                self._began.set()
            elif self.bus:
                message = can.Message(arbitration_id=int(id_, 16), data=bytes.fromhex(data), is_extended_id=False)
                self.bus.send(message)


class Line:
    """Drives that share a bus, until `end`."""

    def __init__(self, nodes):
        program = built()
        self._bus = can.Bus(interface="udp_multicast", channel=GROUP, port=PORT)
        self.drives = [Drive(program, self._bus, **node) for node in nodes]
        self._notifier = can.Notifier(self._bus, [self._hear], timeout=0.05)

    def _hear(self, message):
        for drive in self.drives:
            drive.hear(f"{message.arbitration_id:03X} {bytes(message.data).hex()}\n")

    def pull(self):
        """The bus is pulled: nothing arrives, and nothing leaves."""
        for drive in self.drives:
            drive.bus = None
        self._notifier.stop()

    def end(self):
        self._notifier.stop()
        for drive in self.drives:
            drive.end()
        self._bus.shutdown()
