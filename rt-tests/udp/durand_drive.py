"""Drives of CiA 402 on `durand`, a second CANopen stack that is not the project's: its own SDO server, mapping of
process data, SYNC and heartbeat. Unlike canopen_drive.py it keeps its mapping through a reset of communication."""

import random
import struct
import threading
import time

import can
import durand
from durand import DatatypeEnum as T
from durand.scheduler import SyncScheduler

GROUP, PORT = "239.74.163.2", 43113
LINK_COUNTS, MOTOR_COUNTS, RATIO = 524288, 65536, 100
TURN = 6.283185307179586
#: Of the test joint without gravity: inertia of rotor and link, kg·m²; gear, N·m/rad; friction, N·m; N·m/A.
INERTIA, LINK_INERTIA, STIFFNESS, FRICTION, TORQUE_PER_AMPERE = 0.704, 0.59, 8333.0, 1.5, 5.0
RATED_A = 5.0
#: Position and velocity gain of the drive's loop, N·m/rad and N·m·s/rad.
GAINS = 6000.0, 120.0
SUBSTEPS = 10
READY, ON, ENABLED, QUICK_STOP, DISABLED, FAULT = 0x31, 0x33, 0x37, 0x17, 0x40, 0x08
#: index, type, access, value at power-on
OBJECTS = [
    (0x1001, T.UNSIGNED8, "ro", 0), (0x2240, T.INTEGER32, "ro", 0), (0x6007, T.INTEGER16, "rw", 0),
    (0x603F, T.UNSIGNED16, "ro", 0), (0x6040, T.UNSIGNED16, "rw", 0), (0x6041, T.UNSIGNED16, "ro", DISABLED),
    (0x6060, T.INTEGER8, "rw", 0), (0x6061, T.INTEGER8, "ro", 0), (0x6064, T.INTEGER32, "ro", 0),
    (0x6065, T.UNSIGNED32, "rw", 2000), (0x6071, T.INTEGER16, "rw", 0), (0x6075, T.UNSIGNED32, "rw", 5000),
    (0x6078, T.INTEGER16, "ro", 0), (0x607A, T.INTEGER32, "rw", 0), (0x6502, T.UNSIGNED32, "ro", 0x380),
]  # fmt: skip


class Drive:
    """A drive with a bus member of its own, until `end`."""

    def __init__(self, node, degrees, period_s=0.005):
        self.period_s, self.velocity, self.torque = period_s, 0.0, 0.0
        self.angle = degrees / 360 * TURN
        self.nmt_states, self.heard, self.stopped_after, self.worst_jump, self.enabled_at = [], None, None, 0.0, None
        self._lock = threading.RLock()
        self._bus = can.Bus(interface="udp_multicast", channel=GROUP, port=PORT)
        self._network = durand.CANBusNetwork(self._bus)
        self.node = durand.MinimalNode(self._network, node)
        self.objects = self.node.object_dictionary
        for index, kind, access, value in OBJECTS:
            self.objects[index] = durand.Variable(kind, access, value)
        self.objects[0x1016] = durand.Array(durand.Variable(T.UNSIGNED32, "rw", 0), length=1)
        interpolation = durand.Record()
        interpolation[1] = durand.Variable(T.UNSIGNED8, "rw", 1)
        interpolation[2] = durand.Variable(T.INTEGER8, "rw", -3)
        self.objects[0x60C2] = interpolation
        for sub, value in enumerate((0x5A, 402, 1, node), 1):
            self.objects.write(0x1018, sub, value)
        self.objects.write(0x1000, 0, 0x00020192)
        self.objects.update_callbacks[(0x6060, 0)].add(lambda mode: self.objects.write(0x6061, 0, mode))
        self.objects.update_callbacks[(0x6040, 0)].add(self._control)
        self.node.nmt.state_callbacks.add(lambda state: self.nmt_states.append(state.name))
        # Before any process data is sent.
        self.node.sync.callbacks.add(self._sync)
        self._network.add_subscription(0x77F, self._heartbeat)
        self._ended = threading.Event()
        self._watch = threading.Thread(target=self._watching)
        self._watch.start()

    def value(self, index, sub=0):
        return self.objects.read(index, sub)

    @property
    def degrees(self):
        return self.angle / TURN * 360

    @property
    def state(self):
        return self.value(0x6041) & 0x7F

    @property
    def enabled(self):
        return self.state in (ENABLED, QUICK_STOP)

    @property
    def operational(self):
        return self.node.nmt.state.name == "OPERATIONAL"

    def pull(self):
        """Its bus is pulled: nothing arrives, and nothing leaves."""
        self._network.stop()
        self._network.send = lambda *_: None

    def end(self):
        self._ended.set()
        self._watch.join()
        self._network.stop()
        self._bus.shutdown()

    def _enter(self, state):
        self.objects.write(0x6041, 0, state | 0x200)

    def _heartbeat(self, *_):
        self.heard = time.monotonic()

    def _watching(self):
        """Supervision of the master by 1016, and its reaction by 6007: 3 is quick stop."""
        while not self._ended.wait(0.005):
            limit_s = (self.value(0x1016, 1) & 0xFFFF) / 1000
            silent = time.monotonic() - self.heard if self.heard else 0.0
            if limit_s and silent > limit_s and self.enabled and self.value(0x6007) == 3:
                self.stopped_after = silent
                self._enter(DISABLED)

    def _control(self, word):
        """CiA 402 by the control word."""
        state = self.state
        if state & 0x0F == FAULT:
            state = DISABLED if word & 0x80 else state
        elif not word & 0x02:
            state = DISABLED
        elif not word & 0x04:
            state = QUICK_STOP if state in (ENABLED, QUICK_STOP) else DISABLED
        elif word & 0x0F == 0x06 and state in (DISABLED, READY, ON, ENABLED):
            state = READY
        elif word & 0x0F == 0x07 and state in (READY, ON, ENABLED):
            state = ON
        elif word & 0x0F == 0x0F and state == ON:
            state = ENABLED
            self.enabled_at = self.degrees, self._target() / TURN * 360
        self._enter(state)

    def _target(self):
        """rad in cyclic synchronous position, N·m in cyclic synchronous torque."""
        if self.value(0x6061) == 8:
            return self.value(0x607A) / LINK_COUNTS * TURN
        return self.value(0x6071) / 1000 * RATED_A * TORQUE_PER_AMPERE

    def _move(self):
        dt, before = self.period_s / SUBSTEPS, self.velocity
        for _ in range(SUBSTEPS):
            if not self.enabled:
                self.torque = 0.0
            elif self.value(0x6061) == 8:
                error = self._target() - self.angle
                self.worst_jump = max(self.worst_jump, abs(error))
                self.torque = GAINS[0] * error - GAINS[1] * self.velocity
            else:
                self.torque = self._target()
            velocity = self.velocity + dt * self.torque / INERTIA
            brake = dt * FRICTION / INERTIA
            self.velocity = velocity - max(-brake, min(brake, velocity))
            self.angle += dt * self.velocity
        return (self.velocity - before) / self.period_s

    def _sync(self):
        with self._lock:
            acceleration = self._move()
            torsion = LINK_INERTIA * acceleration / STIFFNESS
            link = self.angle / TURN * LINK_COUNTS
            motor = (self.angle + torsion) / TURN * RATIO * MOTOR_COUNTS
            current = 1000 * self.torque / TORQUE_PER_AMPERE / RATED_A
            self.objects.write(0x6064, 0, round(link + random.gauss(0.0, 0.5)))
            self.objects.write(0x2240, 0, round(motor + random.gauss(0.0, 0.5)))
            self.objects.write(0x6078, 0, round(current + random.gauss(0.0, 4.0)))


class Line:
    """Drives that share a bus, each with timers of its stack, until `end`."""

    def __init__(self, nodes):
        self._scheduler = SyncScheduler()
        durand.set_scheduler(self._scheduler)
        threading.Thread(target=self._scheduler.run, daemon=True).start()
        self.drives = [Drive(**node) for node in nodes]

    def pull(self):
        for drive in self.drives:
            drive.pull()

    def end(self):
        for drive in self.drives:
            drive.objects.write(0x1017, 0, 0)
            drive.end()
        self._scheduler.stop()
