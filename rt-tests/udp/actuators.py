"""Actuators on python-can: Damiao in MIT mode and RobStride by its private protocol, which answer only when asked,
and ODrive. They follow commands only when enabled, and stop when none comes for a while."""

import math
import random
import struct
import threading
import time
from pathlib import Path

import can
import cantools
import moteus
import odrive_can
from damiao_motor.core.motor import DaMiaoMotor
from moteus import multiplex

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
        #: what its encoder shows too much, rad, the load on its output, N·m, and what its windings make of its torque
        self.slip, self.load, self.commutation = 0.0, 0.0, 1.0

    @property
    def shown(self):
        """Its position as its encoder shows it, to its own loop and to others."""
        return self.q + self.slip

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
            self.torque = kp * (p - self.shown) + kd * (v - self.dq) + t if self.command else 0.0
            self.dq += STEP_S * (self.commutation * self.torque - self.load) / INERTIA
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
        if message.arbitration_id == 0x7FF and data[:3] == bytes([self.id, 0, 0x33]):
            registers = {7: 0x10 + self.id, 9: 4000, 10: 1, 14: 5013, 21: self.P, 22: self.V, 23: self.T}
            value = registers[data[3]]
            packed = struct.pack("<f" if isinstance(value, float) else "<I", value)
            return self.send(0x10 + self.id, data[:4] + packed)
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
        noisy = self.shown + random.gauss(0.0, 2e-4)
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
        if not message.is_extended_id or to != self.id or kind not in (1, 3, 4, 17):
            return
        if kind == 17:
            host, parameter = middle & 0xFF, message.data[:4]
            value = struct.pack("<f", self.q)
            self.send(17 << 24 | self.id << 8 | host, bytes(parameter) + value, extended=True)
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
            count(self.shown + noise(2e-4), -self.P, self.P, 16),
            count(self.dq + noise(1e-3), -self.V, self.V, 16),
            count(self.torque + noise(1e-2), -self.T, self.T, 16),
            350,
        )
        fault = 1 << 16 if self.error else 0
        self.send(2 << 24 | mode << 22 | fault | self.id << 8 | self.HOST, data, extended=True)


class Odrive(Actuator):
    """An axis of an ODrive whose motor turns ten times for the output's once. Its frames are those of the DBC file of
    PyPI odrive-can. It wakes up in mode of velocities, and tells its state ten times a second."""

    DBC = cantools.database.load_file(Path(odrive_can.__file__).parent / "dbc" / "odrive-cansimple-0.6.10.dbc")
    RATIO, TORQUE_CONSTANT, HEARTBEAT_S, ESTIMATES_S = 10.0, 0.05, 0.1, 0.004
    WATCHDOG = 0x1000000

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self.mode, self.gains, self.input = (2, 1), {}, 0.0
        self.tells_current, self.due = True, {"Heartbeat": 0.0, "Get_Encoder_Estimates": 0.0}

    def frame(self, message):
        if message.arbitration_id >> 5 != self.id or message.is_extended_id:
            return
        command = self.DBC.get_message_by_frame_id(message.arbitration_id & 0x1F)
        take = getattr(self, command.name.removeprefix("Axis0_").lower(), None)
        # A group hears its own frames.
        if take:
            take(command.decode(bytes(message.data), decode_choices=False))

    def set_controller_mode(self, values):
        self.mode = values["Control_Mode"], values["Input_Mode"]

    def set_pos_gain(self, values):
        self.gains |= values

    def set_vel_gains(self, values):
        self.gains |= values

    def clear_errors(self, _):
        self.error = 0

    def set_axis_state(self, values):
        wanted = values["Axis_Requested_State"]
        self.words.append({8: "enable", 1: "disable"}[wanted])
        if wanted == 8 and not self.error:
            assert self.mode == (3, 1), "in another mode it would run off"
            self.enable()
            # Its target is what it was told while it was off.
            self.first = self.q, self.input * math.tau / self.RATIO
            self.set_input_pos({"Input_Pos": self.input, "Vel_FF": 0.0, "Torque_FF": 0.0})
        elif wanted == 1:
            self.disable()

    def set_input_pos(self, values):
        self.input, self.commanded = values["Input_Pos"], time.monotonic()
        if not self.enabled:
            off = abs(self.input * math.tau / self.RATIO - self.q) > 2e-3
            self.while_off += [values] if off else []
            return
        # Of the output, in its units.
        velocity, position = self.gains["Vel_Gain"], self.gains["Pos_Gain"]
        assert self.gains["Vel_Integrator_Gain"] == 0.0
        kd = velocity / math.tau * self.RATIO**2
        turn = math.tau / self.RATIO
        t = values["Torque_FF"] * self.RATIO
        self.command = self.input * turn, values["Vel_FF"] * turn, kd * position, kd, t

    def move(self):
        super().move()
        if self.error == 0xD:
            self.error = self.WATCHDOG
        now = time.monotonic()
        if now >= self.due["Heartbeat"]:
            self.due["Heartbeat"] = now + self.HEARTBEAT_S
            state = 8 if self.enabled else 1
            flags = {"Procedure_Result": 0, "Trajectory_Done_Flag": 0}
            self.tell("Heartbeat", {"Axis_Error": self.error, "Axis_State": state} | flags)
        if now >= self.due["Get_Encoder_Estimates"]:
            self.due["Get_Encoder_Estimates"] = now + self.ESTIMATES_S
            current = self.torque / self.RATIO / self.TORQUE_CONSTANT + random.gauss(0.0, 0.02)
            if self.tells_current:
                self.tell("Get_Iq", {"Iq_Setpoint": current, "Iq_Measured": current})
            turns = lambda x: x * self.RATIO / math.tau
            position, velocity = turns(self.q + random.gauss(0.0, 2e-4)), turns(self.dq)
            self.tell("Get_Encoder_Estimates", {"Pos_Estimate": position, "Vel_Estimate": velocity})

    def tell(self, name, values):
        message = self.DBC.get_message_by_name(f"Axis0_{name}")
        self.send(self.id << 5 | message.frame_id, message.encode(values))


class Cubemars(Actuator):
    """An AK70-10 in MIT mode, by the maker's manual: it answers with eight bytes under 0, as its first firmware does,
    and does not tell whether it is on."""

    P, V, T = 12.5, 50.0, 25.0

    def frame(self, message):
        data = bytes(message.data)
        if message.arbitration_id != self.id or message.is_extended_id:
            return
        if data[:7] == b"\xff" * 7:
            what = {0xFC: self.enable, 0xFD: self.disable}[data[7]]
            self.words.append(what.__name__)
            self.error = 0 if data[7] == 0xFD else self.error
            what()
        else:
            self.mit(data)
        self.answer()

    def mit(self, data):
        """A command in MIT mode."""
        bits = int.from_bytes(data, "big")
        part = lambda first, size: bits >> (64 - first - size) & (2**size - 1)
        p, v = number(part(0, 16), -self.P, self.P, 16), number(part(16, 12), -self.V, self.V, 12)
        kp, kd = number(part(28, 12), 0.0, 500.0, 12), number(part(40, 12), 0.0, 5.0, 12)
        t = number(part(52, 12), -self.T, self.T, 12)
        self.follow(p, v, kp, kd, t, 0.51 * 2 * self.T / 4095)

    def state(self):
        """Identifier, position, velocity and torque: six bytes."""
        noise = lambda sigma: random.gauss(0.0, sigma)
        bits = self.id << 40 | count(self.shown + noise(2e-4), -self.P, self.P, 16) << 24
        bits |= count(self.dq + noise(1e-3 * self.V), -self.V, self.V, 12) << 12
        bits |= count(self.torque + noise(1e-3 * self.T), -self.T, self.T, 12)
        return bits.to_bytes(6, "big")

    def answer(self):
        # Of its own errors none is a time-out: it stops.
        error = 7 if self.error else 0
        self.send(0, self.state() + bytes([35, error]))


class Myactuator(Cubemars):
    """An RMD of 24 N·m in motion mode, by the maker's manual: a command switches it on, and another frame tells its
    errors."""

    P, V, T = 12.5, 45.0, 24.0

    def frame(self, message):
        data, identifier = bytes(message.data), message.arbitration_id
        if message.is_extended_id or identifier not in (0x400 + self.id, 0x140 + self.id):
            return
        if identifier == 0x400 + self.id:
            # Without gains it is on as well, and makes no torque.
            moves = int.from_bytes(data, "big") >> 12 & 0xFFFFFF
            if moves and not self.enabled and not self.error:
                self.words.append("enable")
                self.enable()
            self.mit(data)
            self.send(0x500 + self.id, self.state() + bytes(2))
        elif data[0] == 0x80:
            self.words.append("disable")
            self.error = 0
            self.disable()
            self.send(0x240 + self.id, data)
        elif data[0] == 0x9A:
            error = 0x0002 if self.error else 0
            self.send(0x240 + self.id, struct.pack("<BbBBHH", 0x9A, 35, 36, 1, 240, error))


class Moteus(Actuator):
    """A moteus that reads its frames with the parser of PyPI moteus, whose controller also reads its answers. Without
    a command it falls into its mode of time-out."""

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self.registers, self.read, self.fault = {}, None, 0
        self.controller = moteus.Controller(self.id, transport=object())

    def frame(self, message):
        source, destination = message.arbitration_id >> 8, message.arbitration_id & 0xFF
        # Above 16 bits is a prefix, which is none of its own.
        if not message.is_extended_id or destination != self.id or source & 0xFFF80 != 0x80:
            return
        assert message.is_fd
        written, asked = {}, []
        for part in multiplex.parse_frame(bytes(message.data)):
            if part.type == multiplex.SubframeType.WRITE:
                written[part.register] = part.value
            elif part.type == multiplex.SubframeType.READ:
                asked.append((part.register, part.resolution))
        mode = written.get(moteus.Register.MODE)
        if mode == 0:
            self.words.append("disable")
            self.error = self.fault = 0
            self.disable()
        elif mode == 10 and not self.error:
            self.set_position(*(written[0x20 + i] for i in range(5)))
        self.answer(asked, source & 0x7F)

    def set_position(self, position, velocity, torque, kp, kd):
        if not self.enabled:
            self.words.append("enable")
            self.enable()
            assert (torque, kp, kd) == (0.0, 0.0, 0.0), "the first command makes no torque"
        p = self.q if math.isnan(position) else position * math.tau
        v = velocity * math.tau
        # Its own gains are those of the configuration.
        self.follow(p, v, 100.0 * kp, 3.0 * kd, torque, 0.0)

    def answer(self, asked, host):
        mode = 11 if self.error else 10 if self.enabled else 0
        noise = lambda sigma: random.gauss(0.0, sigma)
        values = {
            0: mode,
            1: (self.shown + noise(2e-4)) / math.tau,
            2: (self.dq + noise(1e-3)) / math.tau,
            3: self.torque + noise(0.02),
            4: (self.torque + noise(0.02)) / (10 * 0.05),
            0xD: 48,
            0xE: 35,
            0xF: self.fault,
        }
        data = b""
        for register, resolution in asked:
            kind = 0x20 | resolution << 2 | 1
            data += bytes([kind, register]) + multiplex.TYPES[resolution].pack(values[register])
        size = next(size for size in (8, 12, 16, 20, 24, 32, 48, 64) if size >= len(data))
        data = data.ljust(size, b"\x50")
        sent = can.Message(arbitration_id=self.id << 8 | host, data=data, is_extended_id=True, is_fd=True)
        self.read = self.controller.make_query().parse(sent)
        self.bus.send(sent)


class Line:
    """A bus with actuators, until `end`."""

    def __init__(self, kind, nodes):
        """Of one kind, with positions by node, or of kinds by node."""
        self.bus = can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, fd=True)
        kinds = {node: kind for node in nodes} if kind else nodes
        positions = nodes if kind else dict.fromkeys(nodes, 0.5)
        self.actuators = [kinds[node](self.bus, node, positions[node]) for node in nodes]
        self.pulled, self._ended = False, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._ended.is_set():
            message = self.bus.recv(0.002)
            if self.pulled:
                message = None
            for actuator in self.actuators:
                actuator.move()
                if message is not None:
                    actuator.frame(message)

    def pull(self):
        """The bus is pulled: nothing arrives, and nothing leaves."""
        self.pulled, self.bus.send = True, lambda *_: None

    def end(self):
        self._ended.set()
        self._thread.join()
        self.bus.shutdown()
