"""The second robot, the daemon in front of it, and clients: faults are set, the true motion is measured."""

import gc
import math
import re
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torqued
from processes import BINARIES, Process, forget_faults
from torqued import Mode, RobotState

FOLDER = Path(__file__).parent
NAME = "second-robot"
JOINTS = ["hip", "knee", "ankle"]
START = np.array([-0.5, 1.0, -0.4])
VELOCITY_LIMITS = np.array([4.0, 4.0, 5.0])
RATE_HZ = 500.0
#: Columns of the robot's log: stamp, time until it answered, mark, then those of each joint.
COLUMNS = 3 + 7 * len(JOINTS)
#: State of a drive in the log.
ENABLED = 4
#: Amplitude and frequency of the motion that clients ask for, rad and Hz.
AMPLITUDE, FREQUENCY_HZ = 0.25, 0.5
#: Pauses of daemon, robot or client from which on a run is not judged, ms: one that does not hold, and one that
#: holds, perhaps because time-outs have ended it; a client's, between two references.
PAUSE_FAILED_MS, PAUSE_PASSED_MS, CLIENT_PAUSE_MS = 6.0, 18.0, 30.0
EVENT_NUMBERS = [event.number for event in torqued.EVENTS]


def configuration(folder, changes=()):
    """A copy of the robot's configuration with words replaced, each of which must occur."""
    for name in ("robot.toml", "robot.urdf", "frames.dbc"):
        shutil.copy(FOLDER / name, folder)
    path = folder / "robot.toml"
    text = path.read_text()
    for old, new in dict(changes).items():
        assert old in text, f"{path} has no {old!r}"
        text = text.replace(old, new)
    path.write_text(text)
    return path


def by_current(folder, stiffness):
    """The configuration at 250 Hz with drives that take currents, and filters as long in samples as at 1 kHz;
    the joints' stiffness, Nm/rad, and a tenth of it as damping."""
    path = configuration(folder, {
        "rate_hz = 500.0": "rate_hz = 250.0",
        "gather_deadline_us = 1500.0": "gather_deadline_us = 3000.0",
        'law = "predictive"\ntorque_feedback = "levelled"': 'law = "proportional_integral"\ntorque_feedback = "encoder"',
    })  # fmt: skip
    text = path.read_text()
    text = re.sub(r"\[filters\].*?\n\n", "", text, flags=re.S)
    text = re.sub(r'"POSITIONS.(\w+)_position"', r'"CURRENTS.\1_demand"', text)
    text = re.sub(
        r"K_tau_rad.*\nK_v_s.*\nK_c_rad.*\n", "K_1_Nm_per_A = K1\nK_2_Nms_per_rad = K2\nK_3_Nm = K3\n", text
    )
    for ratio, constant, coulomb, viscous, limit in (
        (100, 0.1, 0.05, 4e-5, 12),
        (120, 0.09, 0.05, 4e-5, 13.8),
        (100, 0.06, 0.03, 2e-5, 10),
    ):
        for name, value in (("K1", ratio * constant), ("K2", ratio**2 * viscous), ("K3", 0.8 * ratio * coulomb)):
            text = text.replace(f"= {name}\n", f"= {value:.4g}\n", 1)
        text = text.replace('command = "position"', f'command = "current"\ncurrent_limit_A = {limit}', 1)
    for joint, gain in zip(JOINTS, stiffness):
        gains = f"gains = {{ K_p = 0.0, K_i_per_s = 0.0, K_s_Nm_per_rad = {gain:.1f}, K_d_Nms_per_rad = {gain / 10:.1f} }}"
        text = re.sub(rf'(control = {{ signal = "CONTROL.{joint}_control" }}\n)gains.*', rf"\g<1>{gains}", text)
    path.write_text(text)
    return path


#: Drive's torque constant, Nm/A, and rated current, A.
CANOPEN = {"hip": (0.1, 6), "knee": (0.09, 6), "ankle": (0.06, 5)}


def by_canopen(folder):
    """The configuration with drives that are nodes of CANopen, which no DBC file describes."""
    words = ('dbc = "frames.dbc"\nsync = "SYNC"\nfd = true\n\n', '[[bus]]\nname = "foot"')
    path = configuration(folder, {"".join(words): "\n" + words[1]})
    text = path.read_text()
    for node, (joint, (constant, current)) in enumerate(CANOPEN.items(), 1):
        text = text.replace(
            f'command = "position"\n[drive.{joint}.state]\n',
            f'command = "position"\nprofile = "cia402"\n[drive.{joint}.canopen]\nposition = "motor"\n'
            f'other_angle = "2240:00"\nrated_current_A = {current}.0\nrated_torque_Nm = {constant * current:.2f}\n'
            f"[drive.{joint}.state]\n",
        )
        signals = rf'motor_angle = {{ signal = "{joint.upper()}\..*\n(?:.*signal.*\n)*'
        text, count = re.subn(signals, f"node = {node}\n", text)
        assert count == 1, joint
    path.write_text(text)
    return path


class Robot:
    """The robot's process; `options`: further arguments of it."""

    def __init__(self, program, folder, rate_hz=RATE_HZ, options=()):
        self.log = folder / "truth.bin"
        self._process = subprocess.Popen(
            [program, str(rate_hz), self.log, *options],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
        )  # fmt: skip
        assert self._process.stdout.readline() == "ready\n"

    def set(self, *faults):
        """Sets faults: "name joint value", "name - value" of the robot; all at once."""
        self._process.stdin.write("".join(fault + "\n" for fault in faults))
        self._process.stdin.flush()

    def truth(self):
        """All periods so far."""
        self.set("flush - 0")
        assert self._process.stdout.readline() == "flushed\n"
        raw = np.fromfile(self.log)
        return raw[: len(raw) // COLUMNS * COLUMNS].reshape(-1, COLUMNS)

    def end(self):
        self._process.kill()
        self._process.wait()


class DisturbedError(Exception):
    """The machine paused daemon, robot or client."""


class Mover(threading.Thread):
    """A client that asks for a mode until it is ended, and keeps the error that ended it."""

    def __init__(self, client, mode):
        super().__init__(daemon=True)
        self.mode, self.error, self.paused_ms = mode, "", 0.0
        self.begun, self.over = threading.Event(), threading.Event()
        self._client = client
        self.start()

    def run(self):
        try:
            self._client.latest()
            with torqued.Commander(self._client) as commander:
                commander.hold_until_ready(10.0)
                self._prepare(commander)
                began = sent = time.monotonic()
                self.begun.set()
                while not self.over.is_set():
                    now = time.monotonic()
                    self.paused_ms, sent = max(self.paused_ms, 1e3 * (now - sent)), now
                    self._move(commander.reference, now - began)
                    commander.send()
                    time.sleep(0.004)
        except Exception as error:  # what a user's program would be told
            self.error = f"{type(error).__name__}: {error}"
        finally:
            self.begun.set()

    def _prepare(self, commander):
        reference = commander.reference
        if self.mode == "torque":
            record = self._client.latest() or self._client.next_record()
            for desired, joint in zip(reference.joints, record.cycle.estimated.joints[: len(JOINTS)]):
                desired.tau_d = joint.tau_hat.tau
            reference.mode = Mode.TORQUE
        elif self.mode == "passive":
            commander.let_go(JOINTS)
        elif self.mode == "cartesian":
            frame = commander.lead_frames(self._client, ["foot"])["foot"]
            frame.stiffness[:] = (3000, 3000, 3000, 50, 50, 50)
            reference.mode = Mode.CARTESIAN
        else:
            modes = {
                "motion": Mode.INVERSE_DYNAMICS,
                "feedback": Mode.TORQUE_FEEDBACK_MOTION,
                "position": Mode.POSITION,
            }
            reference.mode = modes[self.mode]
        self._q0 = [joint.q_d for joint in reference.joints[: len(JOINTS)]]

    def _move(self, reference, t):
        if self.mode not in ("motion", "feedback"):
            return
        w = 2 * math.pi * FREQUENCY_HZ
        for joint, q0, sign in zip(reference.joints, self._q0, (1, 1, -1)):
            joint.q_d = q0 + sign * AMPLITUDE * (1 - math.cos(w * t)) / 2
            joint.dq_d = sign * AMPLITUDE * w * math.sin(w * t) / 2
            joint.ddq_d = sign * AMPLITUDE * w * w * math.cos(w * t) / 2

    def end(self):
        self.over.set()
        self.join(2.0)


@dataclass
class Result:
    """What a run has shown."""

    degrees: float  #: way of the joint that left its range of before furthest
    joint: str
    per_cent: float  #: speed beyond that of before, of the velocity limit
    faster: str
    fault: int
    subject: str
    state: RobotState
    events: dict = field(repr=False)
    told: str = ""  #: what the client was told
    paused_ms: float = 0.0  #: longest pause of daemon or robot
    client_ms: float = 0.0  #: longest time between two references of the client

    def is_judged(self, holds, paused_ms=(PAUSE_FAILED_MS, PAUSE_PASSED_MS)):
        """Whether the machine has not disturbed the run."""
        return self.paused_ms < paused_ms[holds] and (holds or self.client_ms < CLIENT_PAUSE_MS)

    def __str__(self):
        events = " ".join(f"{number}x{count}" for number, count in self.events.items() if number not in (501, 502))
        return (
            f"{self.degrees:.2f} deg ({self.joint}), {self.per_cent:.1f} % ({self.faster}); fault {self.fault} "
            f"{self.subject}, {self.state.name.lower()}; events {events or 'none'}; pause {self.paused_ms:.1f} ms; {self.told}"
        )


class Leg:
    """Robot and daemon, from power-on; used in a `with` block."""

    def __init__(self, program, folder, configure=configuration, faults=(), rate_hz=RATE_HZ, options=()):
        """`configure` writes the configuration into a folder; its path. `options`: of torqued run."""
        folder.mkdir()
        self.robot = Robot(program, folder, rate_hz, ["canopen"] if configure is by_canopen else [])
        self.robot.set(*faults)
        self._mark = 0
        self.mover = None
        self.period_s = 1 / rate_hz
        forget_faults()
        self.daemon = Process(BINARIES / "torqued", "run", configure(folder), "--json", *options)
        try:
            self.daemon.wait_for("running")
            self.client = torqued.Client(NAME, timeout_s=10.0)
            self._for_mover = torqued.Client(NAME, timeout_s=10.0)
        except BaseException:
            self.__exit__(*sys.exc_info())
            raise

    def __enter__(self):
        return self

    def __exit__(self, kind=None, *_):
        silent = kind is not None and issubclass(kind, torqued.NoDaemonError) and self.daemon.runs()
        slow = silent and self._paused_ms(self.robot.truth()) > PAUSE_PASSED_MS
        if self.mover:
            self.mover.end()
        self.daemon.kill()
        self.robot.end()
        # A service has room for so many subscribers, and the next daemon's has the same name.
        self.client = self._for_mover = self.mover = None
        gc.collect()
        if slow:
            raise DisturbedError("the daemon runs, but its records or answers did not come in time")

    def record(self):
        """The newest record."""
        self.client.latest()
        return self.client.next_record(5.0).cycle

    def wait(self, *states, limit_s=10.0):
        """Waits for one of these states; whether it came."""
        until = time.monotonic() + limit_s
        while self.record().state not in states:
            if time.monotonic() > until:
                return False
        return True

    def enable(self):
        """As an operator does: waits until it can be enabled, enables, and shows what it was told."""
        if not self.wait(RobotState.READY, limit_s=4.0):
            return f"not ready, but {RobotState(self.record().state).name.lower()}"
        try:
            self.client.enable()
        except torqued.RefusedError as error:
            return str(error)
        # Clients whose first wish for hold came before the request are told so; a robot that kicks is in fault.
        self.wait(RobotState.HOLDING, RobotState.FAULT, limit_s=2.0)
        return ""

    def start(self):
        """Enables a robot that is sound."""
        refused = self.enable()
        self.require(not refused, refused)

    def acknowledge(self):
        """Acknowledges the latched fault."""
        try:
            self.client.acknowledge(self.record().fault)
        except torqued.RefusedError as error:
            return str(error)
        return ""

    def begin(self, mode):
        """A client asks for that mode, or none does in "hold"; settled afterwards."""
        if mode == "hold":
            time.sleep(0.4)
            return
        self.mover = Mover(self._for_mover, mode)
        self.mover.begun.wait(15.0)
        time.sleep(2.3 if mode in ("motion", "feedback") else 0.8)
        self.require(not self.mover.error, self.mover.error)

    def require(self, condition, what):
        """Fails unless the condition is met, or the machine has disturbed the run so far."""
        if not condition:
            paused = self._paused_ms(self.robot.truth()) > PAUSE_FAILED_MS
            if paused or self.mover and self.mover.paused_ms > CLIENT_PAUSE_MS:
                raise DisturbedError(what)
        assert condition, what

    def _paused_ms(self, rows):
        """Longest pause within these periods: those without a SYNC of their own have the stamp of the last one."""
        stamps, periods = np.unique(rows[:, 0], return_counts=True)
        gaps = [*(np.diff(stamps) - self.period_s), (periods.max(initial=1) - 1) * self.period_s]
        return 1e3 * max(*gaps, rows[:, 1].max(initial=0.0))

    def mark(self, *faults):
        """Sets faults and marks the robot's log from that moment on."""
        self._mark += 1
        self.robot.set(f"mark - {self._mark}", *faults)
        return self._mark

    def judge(self, mark, events_before, before_s=0.3):
        """The true motion since a mark, beside that of `before_s` before it."""
        cycle = self.record()
        rows = self.robot.truth()
        first = int(np.argmax(rows[:, 2] >= mark))
        before = rows[max(0, first - round(before_s / self.period_s)) : first]
        q = [part[:, 3::7] for part in (before, rows[first:])]
        dq = [np.abs(part[:, 4::7]) for part in (before, rows[first:])]
        way = np.maximum(q[0].min(0) - q[1].min(0), q[1].max(0) - q[0].max(0)).clip(0)
        speed = (dq[1].max(0) - dq[0].max(0)).clip(0) / VELOCITY_LIMITS
        # A pause after the first motion beyond the narrowest bounds, or after a drive is off, has not caused it.
        degree, slow = math.radians(1), dq[0].max(0) + 0.1 * VELOCITY_LIMITS
        beyond = (q[1] < q[0].min(0) - degree) | (q[1] > q[0].max(0) + degree) | (dq[1] > slow)
        off = (rows[first:, 8::7] != ENABLED) & (before[-1:, 8::7] == ENABLED)
        decided = (beyond | off).any(1)
        until = first + int(decided.argmax()) + 1 if decided.any() else len(rows)
        kind, index = cycle.fault_subject >> 16, cycle.fault_subject & 0xFFFF
        difference = np.array(cycle.events[:]) - events_before
        return Result(
            degrees=math.degrees(way.max()),
            joint=JOINTS[int(way.argmax())],
            per_cent=100 * speed.max(),
            faster=JOINTS[int(speed.argmax())],
            fault=cycle.fault,
            subject={1: JOINTS[index % len(JOINTS)], 2: "F/T sensor"}.get(kind, ""),
            state=RobotState(cycle.state),
            events={EVENT_NUMBERS[i]: int(n) for i, n in enumerate(difference) if n},
            told=self.mover.error if self.mover else "",
            paused_ms=self._paused_ms(rows[first - len(before) : until]),
            client_ms=self.mover.paused_ms if self.mover else 0.0,
        )

    def inject(self, *faults, window_s=1.5, before_s=0.3):
        """Sets faults; what has happened when the window is over."""
        events = np.array(self.record().events[:])
        mark = self.mark(*faults)
        time.sleep(window_s)
        return self.judge(mark, events, before_s)
