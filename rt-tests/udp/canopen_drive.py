"""Drives of CiA 402 on python-canopen's LocalNode: they wake up pre-operational, exchange process data only
when told to, insist on the order of a mapping, follow their target only when enabled, and stop when the
master's heartbeat ends."""

import random
import struct
import threading
import time

import can
import canopen
from canopen import objectdictionary as od
from canopen.sdo import SdoAbortedError

GROUP, PORT = "239.74.163.2", 43113
COUNTS = 524288
MOTOR_COUNTS = 65536
RATIO = 100
#: joint side: N·m/A, N·m, kg·m² of rotor and link, N·m/rad
TORQUE_PER_AMPERE, COULOMB, ROTOR, LINK, STIFFNESS = 5.0, 1.5, 0.114, 0.59, 8333.0
RATED_A = 5.0
STEPS = 8
U8, U16, U32 = od.UNSIGNED8, od.UNSIGNED16, od.UNSIGNED32
I8, I16, I32 = od.INTEGER8, od.INTEGER16, od.INTEGER32
#: index, type, access, value, can be mapped
VARIABLES = [
    (0x1000, U32, "ro", 0x00020192, False), (0x1001, U8, "ro", 0, True), (0x1017, U16, "rw", 0, False),
    (0x2240, I32, "ro", 0, True), (0x6007, I16, "rw", 1, False), (0x603F, U16, "ro", 0, True),
    (0x6040, U16, "rw", 0, True), (0x6041, U16, "ro", 0x0240, True), (0x6060, I8, "rw", 1, True),
    (0x6061, I8, "ro", 1, True), (0x6064, I32, "ro", 0, True), (0x6065, U32, "rw", 1000, False),
    (0x6071, I16, "rw", 0, True), (0x6075, U32, "rw", 5000, False), (0x6078, I16, "ro", 0, True),
    (0x607A, I32, "rw", 0, True), (0x6502, U32, "ro", 0x3AD, False),
]  # fmt: skip
OFF, READY, ON, ENABLED = 0x0240, 0x0231, 0x0233, 0x0237


def dictionary(node, own=()):
    """Objects of a drive; `own`: variables that this one has besides."""
    result = od.ObjectDictionary()
    for index, kind, access, value, _ in (*VARIABLES, *own):
        result.add_object(variable(f"{index:04X}", index, 0, kind, access, value))
    records = {
        0x1016: [(1, U32, "rw", 0)],
        0x1018: [(1, U32, "ro", 0x5A), (2, U32, "ro", 402), (3, U32, "ro", 1), (4, U32, "ro", node)],
        0x60C2: [(1, U8, "rw", 1), (2, I8, "rw", -3)],
    }
    for number in range(4):
        for base, cob in ((0x1400, 0x200), (0x1800, 0x180)):
            cob_id = cob + 0x100 * number + node
            records[base + number] = [(1, U32, "rw", cob_id), (2, U8, "rw", 255)]
            entries = [(sub, U32, "rw", 0) for sub in range(1, 9)]
            records[base + 0x200 + number] = [(0, U8, "rw", 0), *entries]
    for index, entries in records.items():
        record = od.ODRecord(f"{index:04X}", index)
        if all(sub for sub, *_ in entries):
            record.add_member(variable(f"{index:04X}sub0", index, 0, U8, "ro", len(entries)))
        for sub, kind, access, value in entries:
            record.add_member(variable(f"{index:04X}sub{sub}", index, sub, kind, access, value))
        result.add_object(record)
    return result


def variable(name, index, sub, kind, access, value):
    made = od.ODVariable(name, index, sub)
    made.data_type, made.access_type, made.default = kind, access, value
    return made


class Line:
    """A bus with drives, until `end`. `drives`: the arguments of each."""

    def __init__(self, drives, period_s=0.005):
        self.network = canopen.Network(can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, fd=True))
        self.network.connect()
        self.lock = threading.RLock()
        self.drives = [Drive(self, period_s, **arguments) for arguments in drives]
        self._ended = threading.Event()
        self._watch = threading.Thread(target=self._watching)
        self._watch.start()

    def _watching(self):
        while not self._ended.wait(0.005):
            with self.lock:
                for drive in self.drives:
                    drive.watch()

    def pull(self):
        """The bus is pulled: nothing arrives, and nothing leaves."""
        self.network.notifier.stop()
        self.network.bus.send = lambda *_, **__: None

    def end(self):
        self._ended.set()
        self._watch.join()
        self.network.disconnect()


class Drive:
    """One drive. `refuse`: an object whose writing it aborts; `forget`: one of which it keeps nothing; `lose`:
    numbers of SDO answers that are lost; `cut`: number of the SDO answer in whose place its power is cut; `torque`:
    its greatest torque, thousandths of the rated one."""

    def __init__(
        self, line, period_s, node=3, degrees=30.0, vendor=0x5A, refuse=None, forget=None, lose=(), cut=None,
        torque=None,
    ):  # fmt: skip
        self.line, self.period_s, self.id, self.refuse, self.forget = line, period_s, node, refuse, forget
        self.vendor, self.deaf = vendor, False
        self.q, self.dq, self.ddq, self.amperes = degrees / 360 * COUNTS, 0.0, 0.0, 0.0
        self.enabled_at, self.worst_jump = None, 0.0
        self.nmt, self.aborts = [], []
        own = [(0x6072, U16, "rw", torque, False)] if torque else []
        self.node = line.network.add_node(canopen.LocalNode(node, dictionary(node, own)))
        self.answers, self.lose, self.cut, self._answer = 0, lose, cut, self.node.sdo.send_response
        self.node.sdo.send_response = self._answered
        self.node.add_write_callback(self._written)
        self.node.add_read_callback(self._read)
        line.network.subscribe(0x000, self._network)
        line.network.subscribe(0x080, self._sync)
        line.network.subscribe(0x77F, self._heartbeat)
        for number in range(4):
            line.network.subscribe(0x200 + 0x100 * number + node, self._received)
        self.power_on()

    def power_on(self):
        """All that it was told is lost."""
        with self.line.lock:
            self.heartbeats, self.heard, self.stopped_after = 0, None, None
            self.node.nmt.stop_heartbeat()
            self.node.data_store.clear()
            self._set(0x1018, 1, struct.pack("<I", self.vendor))
            self._boot()

    def number(self, index, sub=0):
        return int.from_bytes(self.node.get_data(index, sub), "little")

    @property
    def degrees(self):
        return self.q * 360 / COUNTS

    @property
    def operational(self):
        return self.node.nmt.state == "OPERATIONAL"

    @property
    def enabled(self):
        return self.number(0x6041) == ENABLED

    def fail(self, code):
        """An error of its own."""
        with self.line.lock:
            self._set(0x603F, 0, struct.pack("<H", code))
            self._set(0x6041, 0, struct.pack("<H", 0x0208 | 0x08))
            self.node.emcy.send(code, 1)

    def watch(self):
        """Supervision of the master by 1016."""
        consumer = self.number(0x1016, 1)
        if self.heard is None or not consumer & 0xFFFF:
            return
        silent = time.monotonic() - self.heard
        if silent > (consumer & 0xFFFF) / 1000:
            self.heard = None
            self.node.emcy.send(0x8130, 0x11)
            if self.enabled and self.number(0x6007) == 3:
                self.stopped_after = silent
                self._set(0x6041, 0, struct.pack("<H", OFF))

    def _set(self, index, sub, data):
        self.node.data_store.setdefault(index, {})[sub] = bytes(data)

    def _boot(self):
        self._set(0x6041, 0, struct.pack("<H", OFF))
        self.node.nmt.send_command(0x81)
        self.node.nmt.send_command(0x80)

    def _network(self, _, data, __):
        command, node = data[:2]
        if node in (0, self.id):
            self.nmt.append(command)
            if command in (0x81, 0x82):
                with self.line.lock:
                    self.node.nmt.stop_heartbeat()
                    for index in [i for i in self.node.data_store if i < 0x2000 and i != 0x1018]:
                        del self.node.data_store[index]
                    self.heard = None
                    self._boot()

    def _heartbeat(self, *_):
        self.heartbeats += 1
        self.heard = time.monotonic()

    def _abort(self, code, index, sub):
        self.aborts.append((code, index, sub))
        raise SdoAbortedError(code)

    def _answered(self, response):
        self.answers += 1
        if self.answers == self.cut:
            self.power_on()
        elif self.answers not in self.lose:
            self._answer(response)

    def _written(self, index, subindex, od, data):
        """What a drive insists on, whoever writes."""
        if self.refuse == (index, subindex):
            self._abort(0x06090030, index, subindex)
        if 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00:
            if not self.number(index - 0x200, 1) >> 31:
                self._abort(0x06010000, index, subindex)
            if subindex and self.number(index, 0):
                self._abort(0x06010000, index, subindex)
            mappable = {index for index, *_, can_be in VARIABLES if can_be}
            if subindex and struct.unpack("<I", data)[0] >> 16 not in mappable:
                self._abort(0x06040041, index, subindex)
        if index == 0x6060:
            self._set(0x6061, 0, data)
        if index == 0x6040:
            self._set(0x6040, 0, data)
            self._control()

    def _read(self, index, subindex, od):
        return bytes(4) if self.forget == (index, subindex) else None

    def _mapped(self, mapping):
        for sub in range(1, self.number(mapping, 0) + 1):
            entry = self.number(mapping, sub)
            yield entry >> 16, (entry & 0xFF) // 8

    def _received(self, cob_id, data, _):
        with self.line.lock:
            for number in range(4):
                own = self.number(0x1400 + number, 1)
                if not self.operational or own != cob_id:
                    continue
                for index, size in self._mapped(0x1600 + number):
                    self._set(index, 0, data[:size])
                    data = data[size:]
            self._control()

    def _control(self):
        """The state machine of CiA 402, by the control word."""
        if self.deaf:
            return
        word, status = self.number(0x6040), self.number(0x6041)
        if status & 0x4F == 0x08:
            status = OFF if word & 0x80 else status
        elif word & 0x02 == 0:
            status = OFF
        elif word & 0x07 == 0x06:
            status = READY
        elif word & 0x0F == 0x07 and status in (READY, ON, ENABLED):
            status = ON
        elif word & 0x0F == 0x0F and status == ON:
            status = ENABLED
            self.enabled_at = self.degrees, self._target() * 360 / COUNTS
        self._set(0x6041, 0, struct.pack("<H", status))

    def _target(self):
        """Counts in mode 8; in mode 10 thousandths of the rated torque."""
        if self.number(0x6061) == 8:
            return struct.unpack("<i", self.node.get_data(0x607A, 0))[0]
        return struct.unpack("<h", self.node.get_data(0x6071, 0))[0]

    def _move(self):
        """One period of joint and drive, without gravity."""
        position_mode = self.number(0x6061) == 8
        before, dt = self.dq, self.period_s / STEPS
        for _ in range(STEPS):
            turn, old = 2 * 3.141592653589793 / COUNTS, self.dq
            if not self.enabled:
                torque = 0.0
            elif position_mode:
                error = (self._target() - self.q) * turn
                self.worst_jump = max(self.worst_jump, abs(error))
                torque = 6000.0 * error - 120.0 * self.dq + COULOMB * (self.dq > 0) - COULOMB * (self.dq < 0)
                torque = max(-50.0, min(50.0, torque))
            else:
                torque = TORQUE_PER_AMPERE * RATED_A * self._target() / 1000
            brake = dt * COULOMB / (ROTOR + LINK)
            self.dq += dt * torque / (ROTOR + LINK)
            self.dq -= max(-brake, min(brake, self.dq))
            self.q += dt * 0.5 * (self.dq + old) / turn
            self.amperes = torque / TORQUE_PER_AMPERE
        self.ddq = (self.dq - before) / self.period_s

    def _sync(self, *_):
        with self.line.lock:
            self._move()
            torsion = LINK * self.ddq / STIFFNESS * COUNTS / (2 * 3.141592653589793)
            motor = (self.q + torsion) * RATIO * MOTOR_COUNTS / COUNTS
            self._set(0x6064, 0, struct.pack("<i", round(self.q + random.gauss(0.0, 0.5))))
            self._set(0x2240, 0, struct.pack("<i", round(motor + random.gauss(0.0, 0.5))))
            per_mille = round(1000 * self.amperes / RATED_A + random.gauss(0.0, 4.0))
            self._set(0x6078, 0, struct.pack("<h", per_mille))
            if not self.operational:
                return
            for number in range(4):
                cob_id = self.number(0x1800 + number, 1)
                if cob_id >> 31 or self.number(0x1800 + number, 2) != 1:
                    continue
                parts = [self.node.get_data(i, 0)[:size] for i, size in self._mapped(0x1A00 + number)]
                self.line.network.send_message(cob_id & 0x7FF, b"".join(parts))
