"""Actuators that answer only when asked, on python-can: Damiao in MIT mode and RobStride by its private protocol.
They follow commands only when enabled, and stop when none comes for a while."""

import math
import random
import struct
import threading
import time

import can
from damiao_motor.core.motor import DaMiaoMotor

GROUP, PORT = "239.74.163.2", 43113
#: kg·m² and N·m of an output without gravity
INERTIA, COULOMB = 0.7, 0.3
STEP_S = 0.0005
TIME_OUT_S = 0.2


def count(x, low, high, bits):
    most = 2**bits - 1
    return round((min(max(x, low), high) - low) / (high - low) * most)


def number(count, low, high, bits):
    return low + count / (2**bits - 1) * (high - low)


class Actuator:
    """An output with inertia and friction under `kp (p - q) + kd (v - dq) + t`."""

    def __init__(self, bus, node, position=0.5):
        self.bus, self.id = bus, node
        self.q, self.dq, self.torque, self.error = position, 0.0, 0.0, 0
        self.enabled, self.command, self.commanded, self.then = False, None, None, time.monotonic()
        #: position and first target at the last enabling; gains and torque while off; words; stops
        self.first, self.while_off, self.words, self.stopped_after = None, [], [], None

    def enable(self):
        self.enabled, self.command, self.commanded, self.first = True, None, time.monotonic(), None

    def disable(self):
        self.enabled, self.command = False, None

    def follow(self, p, v, kp, kd, t, half_torque):
        self.commanded = time.monotonic()
        moves = kp or kd or abs(t) > half_torque
        if not self.enabled:
            if moves:
                self.while_off.append((p, v, kp, kd, t))
            return
        if moves:
            self.first = self.first or (self.q, p)
        self.command = p, v, kp, kd, t

    def move(self):
        now = time.monotonic()
        if self.enabled and now - self.commanded > TIME_OUT_S:
            self.stopped_after, self.error = now - self.commanded, 0xD
            self.disable()
        while self.then < now:
            self.then += STEP_S
            p, v, kp, kd, t = self.command or (0.0,) * 5
            self.torque = kp * (p - self.q) + kd * (v - self.dq) + t if self.command else 0.0
            self.dq += STEP_S * self.torque / INERTIA
            brake = STEP_S * COULOMB / INERTIA
            self.dq -= max(-brake, min(brake, self.dq))
            self.q += STEP_S * self.dq

    def send(self, identifier, data, extended=False):
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=extended))


class Damiao(Actuator):
    """A DM4310. Its words are those of PyPI damiao-motor, whose master also reads its answers."""

    P, V, T = 12.5, 30.0, 10.0

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self.master = DaMiaoMotor(self.id, 0x10 + self.id, self, motor_type="4310")
        self.read = None

    def frame(self, message):
        data = bytes(message.data)
        if message.arbitration_id == 0x7FF and data[:3] == bytes([self.id, 0, 0xCC]):
            return self.answer()
        if message.arbitration_id != self.id:
            return None
        for word, what in (
            (self.master.encode_enable_msg(), self.enable),
            (self.master.encode_disable_msg(), self.disable),
            (self.master.encode_clear_error_msg(), self.clear),
        ):
            if data == bytes(word):
                self.words.append(what.__name__)
                what()
                return self.answer()
        bits = int.from_bytes(data, "big")
        part = lambda first, size: bits >> (64 - first - size) & (2**size - 1)
        p, v = number(part(0, 16), -self.P, self.P, 16), number(part(16, 12), -self.V, self.V, 12)
        kp, kd = number(part(28, 12), 0.0, 500.0, 12), number(part(40, 12), 0.0, 5.0, 12)
        t = number(part(52, 12), -self.T, self.T, 12)
        self.follow(p, v, kp, kd, t, 0.51 * 2 * self.T / 4095)
        return self.answer()

    def clear(self):
        self.error = 0

    def answer(self):
        state = self.error or int(self.enabled)
        bits = state << 4 | self.id
        noisy = self.q + random.gauss(0.0, 2e-4)
        for x, size, end in ((noisy, 16, self.P), (self.dq, 12, self.V), (self.torque, 12, self.T)):
            bits = bits << size | count(x + random.gauss(0.0, 1e-3 * end) * (size < 16), -end, end, size)
        data = (bits << 16 | 35 << 8 | 33).to_bytes(8, "big")
        self.read = self.master.decode_sensor_feedback(data, arbitration_id=0x10 + self.id)
        self.send(0x10 + self.id, data)


class Robstride(Actuator):
    """An RS02: torque in the identifier of a command, faults and mode in that of an answer."""

    P, V, T, HOST = 4 * math.pi, 44.0, 17.0, 0xFD

    def frame(self, message):
        identifier = message.arbitration_id
        kind, middle, to = identifier >> 24, identifier >> 8 & 0xFFFF, identifier & 0xFF
        if not message.is_extended_id or to != self.id or kind not in (1, 3, 4):
            return
        if kind == 1:
            p, v, kp, kd = struct.unpack(">4H", message.data)
            p, v = number(p, -self.P, self.P, 16), number(v, -self.V, self.V, 16)
            kp, kd = number(kp, 0.0, 500.0, 16), number(kd, 0.0, 5.0, 16)
            self.follow(p, v, kp, kd, number(middle, -self.T, self.T, 16), 0.51 * 2 * self.T / 65535)
        else:
            what = self.enable if kind == 3 else self.disable
            self.words.append(what.__name__)
            what()
            if kind == 4 and message.data[0] == 1:
                self.error = 0
        self.answer()

    def answer(self):
        mode = 2 if self.enabled else 0
        noise = lambda sigma: random.gauss(0.0, sigma)
        data = struct.pack(
            ">4H",
            count(self.q + noise(2e-4), -self.P, self.P, 16),
            count(self.dq + noise(1e-3), -self.V, self.V, 16),
            count(self.torque + noise(1e-2), -self.T, self.T, 16),
            350,
        )
        fault = 1 << 16 if self.error else 0
        self.send(2 << 24 | mode << 22 | fault | self.id << 8 | self.HOST, data, extended=True)


class Line:
    """A bus with actuators, until `end`."""

    def __init__(self, kind, nodes):
        self.bus = can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, fd=True)
        self.actuators = [kind(self.bus, node, position) for node, position in nodes.items()]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._ended.is_set():
            message = self.bus.recv(0.01)
            for actuator in self.actuators:
                actuator.move()
                if message is not None:
                    actuator.frame(message)

    def end(self):
        self._ended.set()
        self._thread.join()
        self.bus.shutdown()
