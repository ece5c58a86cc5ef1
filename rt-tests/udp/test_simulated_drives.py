"""Masters of other people's in front of the simulated drives of `torqued-sim`: PyPI canopen with its node of CiA 402,
damiao-motor, moteus, odrive-can and robstride. None of them shares a line with the daemon."""

import asyncio
import math
import re
import time

import can
import moteus
import odrive_can
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus
from canopen import Network, SdoAbortedError
from canopen.profiles.p402 import BaseNode402
from canopen_drive import COUNTS, GROUP, PORT, dictionary
from damiao_motor import DaMiaoController
from processes import BINARIES, ROOT, Process
from robstride.client import Client, MotorMode

NODE = 3


class Bus(UdpMulticastBus):
    """A group of which one does not hear one's own frames, as of a CAN bus."""

    def __init__(self):
        self._own = []
        super().__init__(channel=GROUP, port=PORT, fd=True)

    def send(self, msg, timeout=None):
        self._own.append((msg.arbitration_id, bytes(msg.data)))
        super().send(msg, timeout)

    def recv(self, timeout=None):
        until = time.monotonic() + (timeout or 0.0)
        while (message := super().recv(max(0.0, until - time.monotonic()))) is not None:
            key = message.arbitration_id, bytes(message.data)
            if key not in self._own:
                return message
            self._own.remove(key)
        return None


def configuration(folder, name, changes=()):
    """A shipped robot on a multicast group."""
    text = (ROOT / "config" / name / "robot.toml").read_text()
    for pattern, new in (
        (r"\.\./\.\./robot-models", str(ROOT / "robot-models")),
        (r'interface = ".*"', 'kind = "udp_multicast"'),
        *changes,
    ):
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    (folder / "robot.toml").write_text(text)
    sim = (ROOT / "config" / name / "sim.toml").read_text()
    sim = sim.replace("../../robot-models", str(ROOT / "robot-models"))
    # It hangs straight down: without torque it stays there.
    # Coarse steps: it keeps pace with its masters on a busy machine.
    sim = sim.replace("substep_us = 100", "substep_us = 500").replace("joint = 0 }", "joint = 90 }")
    (folder / "sim.toml").write_text(sim)
    return folder / "robot.toml"


@pytest.fixture
def simulated(request, tmp_path):
    """A robot of `torqued-sim`."""
    config = configuration(tmp_path, *request.param)
    with Process(BINARIES / "torqued-sim", config, "--json") as process:
        process.wait_for("ready")
        yield process


@pytest.fixture
def node(simulated):
    """PyPI canopen's node of CiA 402 in front of the simulated drive, just after its communication was reset."""
    network = Network(can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, fd=True))
    network.connect()
    node = network.add_node(BaseNode402(NODE, dictionary(NODE)))
    node.emcy.log.clear()
    node.nmt.state = "RESET COMMUNICATION"
    node.nmt.wait_for_bootup(5.0)
    yield node
    node.rpdo.stop()
    network.sync.stop()
    network.disconnect()


CANOPEN = pytest.mark.parametrize("simulated", [("canopen-joint",)], indirect=True)


def aborted(act):
    with pytest.raises(SdoAbortedError) as caught:
        act()
    return caught.value.code


@CANOPEN
def test_objects_and_the_order_of_a_mapping(node):
    assert node.nmt.state == "PRE-OPERATIONAL"
    assert node.sdo[0x1000].raw & 0xFFFF == 402
    assert node.sdo[0x1018][4].raw == NODE
    assert node.sdo.upload(0x1008, 0) == b"simulated drive of torqued"
    assert aborted(lambda: node.sdo.upload(0x5555, 0)) == 0x06020000
    assert aborted(lambda: node.sdo.upload(0x1018, 9)) == 0x06090011
    assert aborted(lambda: node.sdo.download(0x6041, 0, b"\0\0")) == 0x06010002
    assert aborted(lambda: node.sdo.download(0x6060, 0, b"\0\0")) == 0x06070010
    assert aborted(lambda: node.sdo.download(0x6060, 0, b"\x03")) == 0x06090030
    # A mapping changes only while its PDO is off, and without entries.
    entry = (0x6064 << 16 | 0x20).to_bytes(4, "little")
    assert aborted(lambda: node.sdo.download(0x1A00, 0, b"\0")) == 0x06010000
    node.sdo[0x1800][1].raw = 0x80000180 + NODE
    assert aborted(lambda: node.sdo.download(0x1A00, 1, entry)) == 0x06010000
    node.sdo.download(0x1A00, 0, b"\0")
    unmappable = (0x6075 << 16 | 0x20).to_bytes(4, "little")
    assert aborted(lambda: node.sdo.download(0x1A00, 1, unmappable)) == 0x06040041
    for sub in (1, 2, 3):
        node.sdo.download(0x1A00, sub, entry)
    assert aborted(lambda: node.sdo.download(0x1A00, 0, b"\3")) == 0x06040042
    node.sdo.download(0x1A00, 0, b"\2")
    node.sdo[0x1800][1].raw = 0x180 + NODE
    # And an identifier only while it is off.
    assert aborted(lambda: setattr(node.sdo[0x1800][1], "raw", 0x190 + NODE)) == 0x06090030
    # What was written is gone after the next reset.
    node.nmt.state = "RESET COMMUNICATION"
    node.nmt.wait_for_bootup(5.0)
    assert node.sdo[0x1A00][0].raw == 1


def degrees(node):
    return node.tpdo[1][0x6064].raw * 360 / COUNTS


def to_enabled(node):
    """As a user of canopen would: mapping, mode, target, states. Returns the angle, degrees."""
    node.tpdo.read()
    node.rpdo.read()
    for number in range(2, 5):
        node.tpdo[number].enabled = node.rpdo[number].enabled = False
    node.tpdo[1].clear()
    for index in (0x6041, 0x6064):
        node.tpdo[1].add_variable(index)
    node.tpdo[1].trans_type = 1
    node.rpdo[2].clear()
    node.rpdo[2].add_variable(0x607A)
    node.rpdo[2].enabled = True
    node.tpdo.save()
    node.rpdo.save()
    node.sdo[0x60C2][1].raw = 5
    node.sdo[0x6060].raw = 8
    assert node.sdo[0x6061].raw == 8
    node.sdo[0x607A].raw = node.sdo[0x6064].raw
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"
    node.network.sync.start(0.005)
    # It takes a PDO of type 255 for one that is sent all the time.
    node.rpdo[1].start(0.01)
    for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
        node.state = state
    return degrees(node)


def wait_for(condition, limit_s=5.0):
    until = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.005)


@CANOPEN
def test_a_drive_of_cia402_is_led_by_another_master(node):
    start = to_enabled(node)
    time.sleep(0.3)
    assert abs(degrees(node) - start) < 0.05, "enabled where it stands"
    for step in range(1, 201):
        node.rpdo[2][0x607A].raw = round((start + 0.02 * step) / 360 * COUNTS)
        node.rpdo[2].transmit()
        time.sleep(0.005)
    wait_for(lambda: abs(degrees(node) - start - 4.0) < 0.05)
    node.state = "SWITCH ON DISABLED"
    # Process data end with operation.
    node.nmt.state = "PRE-OPERATIONAL"
    time.sleep(0.1)
    stamp = node.tpdo[1].timestamp
    time.sleep(0.1)
    assert node.tpdo[1].timestamp == stamp


@CANOPEN
def test_a_drive_notices_a_master_that_falls_silent(node):
    node.sdo[0x1017].raw = 50
    node.sdo[0x1016][1].raw = 127 << 16 | 100
    node.sdo[0x6007].raw = 3
    to_enabled(node)
    beat = node.network.send_periodic(0x77F, [5], 0.02)
    time.sleep(0.3)
    assert node.state == "OPERATION ENABLED" and not node.emcy.log
    beat.stop()
    wait_for(lambda: node.emcy.log, 1.0)
    assert node.emcy.log[0].code == 0x8130
    node.nmt.wait_for_heartbeat(1.0)
    assert node.nmt.state == "PRE-OPERATIONAL"
    wait_for(lambda: node.sdo[0x6041].raw & 0x6F != 0x27, 1.0)


#: What distinguishes an actuator of another family from the shipped one.
def family(name, model):
    return ("damiao-joint", [(r'profile = "damiao"', f'profile = "{name}"'), (r'"DM4340"', f'"{model}"')])


@pytest.mark.parametrize("simulated", [("damiao-joint",)], indirect=True)
def test_damiao_is_led_by_damiao_motor(simulated):
    controller = DaMiaoController(channel=GROUP, bustype="udp_multicast")
    controller.bus.shutdown()
    controller.bus = Bus()
    try:
        motor = controller.add_motor(NODE, 0x10 + NODE, "4340")
        assert motor.get_register(9) == 4000
        assert motor.get_register(21) == pytest.approx(12.5)
        motor.request_motor_feedback()
        wait_for(lambda: motor.get_states().get("pos") is not None)
        start = motor.get_states()["pos"]
        # A command moves nothing that is off; this master would enable it first.
        for _ in range(100):
            motor.send_raw(motor.encode_cmd_msg(start + 0.2, 0.0, 0.0, 100.0, 4.0))
            time.sleep(0.005)
        assert abs(motor.get_states()["pos"] - start) < 2e-3
        assert motor.get_states()["status"] == "DISABLED"
        motor.enable()
        command(motor, start + 0.1)
        wait_for(lambda: motor.get_states()["status"] == "ENABLED")
        assert motor.get_states()["pos"] == pytest.approx(start + 0.1, abs=0.02)
        # Without commands it stops, and says so until its error is cleared.
        time.sleep(0.4)
        motor.request_motor_feedback()
        wait_for(lambda: motor.get_states()["status"] == "LOST_COMM")
        motor.clear_error()
        wait_for(lambda: motor.get_states()["status"] == "DISABLED")
    finally:
        controller.shutdown()


def command(motor, position, seconds=1.0):
    for _ in range(round(seconds / 0.005)):
        motor.send_cmd_mit(position, 0.0, 100.0, 4.0, 0.0)
        time.sleep(0.005)


@pytest.mark.parametrize("simulated", [family("robstride", "RS02")], indirect=True)
def test_robstride_is_led_by_robstride(simulated):
    client = Client(Bus(), host_can_id=0xFD)
    start = client.read_param(NODE, "mechpos")
    off = client.disable(NODE)
    assert off.mode == MotorMode.Reset and not off.errors
    assert off.angle == pytest.approx(start, abs=1e-3)
    on = client.enable(NODE)
    assert not on.errors
    assert client.read_param(NODE, "vbus") == pytest.approx(48.0)
    # It sends no commands: without them it stops, and says so.
    time.sleep(0.4)
    assert client.write_param(NODE, "limit_spd", 2.0).errors
    assert client.read_param(NODE, "limit_spd") == pytest.approx(2.0)


MOTEUS = ("damiao-joint", [*family("moteus", "moteus")[1], (r'kind = "udp_multicast"', 'kind = "udp_multicast"\nfd = true')])


@pytest.mark.parametrize("simulated", [MOTEUS], indirect=True)
def test_moteus_is_led_by_moteus(simulated):
    asyncio.run(lead_moteus())


async def lead_moteus():
    transport = moteus.PythonCan(interface="udp_multicast", channel=GROUP, port=PORT, fd=True)
    controller = moteus.Controller(NODE, transport=transport)
    stopped = await controller.set_stop(query=True)
    start = stopped.values[moteus.Register.POSITION]
    assert stopped.values[moteus.Register.MODE] == moteus.Mode.STOPPED
    assert stopped.values[moteus.Register.VOLTAGE] == pytest.approx(48.0)
    target = start + 0.02
    for _ in range(200):
        moved = await controller.set_position(position=target, velocity=0.0, query=True)
        await asyncio.sleep(0.005)
    assert moved.values[moteus.Register.MODE] == moteus.Mode.POSITION
    assert moved.values[moteus.Register.POSITION] == pytest.approx(target, abs=3e-3)
    await asyncio.sleep(0.4)
    late = await controller.query()
    assert late.values[moteus.Register.MODE] == moteus.Mode.TIMEOUT
    again = await controller.set_stop(query=True)
    assert again.values[moteus.Register.MODE] == moteus.Mode.STOPPED


ODRIVE = ("damiao-joint", [
    *family("odrive", "ODrive")[1],
    (r"gear_ratio = 40.0", 'gear_ratio = 40.0\nsampled = "when_sent"\nperiod_us = 4000'),
])  # fmt: skip


@pytest.mark.parametrize("simulated", [ODRIVE], indirect=True)
def test_odrive_is_led_by_odrive_can(simulated):
    asyncio.run(lead_odrive())


async def lead_odrive():
    drive = odrive_can.ODriveCAN(axis_id=NODE, can_bus=Bus())
    seen = []
    drive.feedback_callback = lambda message, _: seen.append(message.data["Pos_Estimate"])
    await drive.start()
    try:
        drive.check_errors()
        assert drive.axis_state == "IDLE"
        await asyncio.sleep(0.2)
        start = seen[-1]
        drive.set_controller_mode("POSITION_CONTROL", "PASSTHROUGH")
        drive.set_input_pos(start)
        drive.set_axis_state_no_wait("CLOSED_LOOP_CONTROL")
        for step in range(200):
            drive.set_input_pos(start + 0.3 * min(1.0, step / 100))
            await asyncio.sleep(0.01)
        assert drive.axis_state == "CLOSED_LOOP_CONTROL"
        assert math.isclose(seen[-1], start + 0.3, abs_tol=0.1)
        await asyncio.sleep(0.5)
        with pytest.raises(odrive_can.odrive.DriveError, match="WATCHDOG"):
            drive.check_errors()
        drive.clear_errors()
        await asyncio.sleep(0.3)
        drive.check_errors()
        assert drive.axis_state == "IDLE"
    finally:
        drive.stop()
