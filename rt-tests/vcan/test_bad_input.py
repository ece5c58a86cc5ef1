"""Wrong frames and configs: refused at the start with a message, counted in the running loop; the
robot never jumps."""

import signal
import socket
import struct
import time

from processes import BINARIES, Process, daemon, derived_config, simulator


def send(interface, identifier, data, count):
    """Puts frames of no known sender on a bus."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.bind((interface,))
        for _ in range(count):
            bus.send(struct.pack("=IB3x8s", identifier, len(data), data))


def test_interface_that_does_not_exist_is_refused(tmp_path):
    config = derived_config(tmp_path, {'interface = "vcan1"': 'interface = "vcan7"'})
    torqued = Process(BINARIES / "torqued", "run", config)
    assert torqued.wait() == 2, torqued.output()
    line = 1 + config.read_text()[: config.read_text().index('"vcan7"')].count("\n")
    assert f"{config}:{line}: " in torqued.output()
    assert "vcan7" in torqued.output()
    assert "vcan0" in torqued.output(), "names the interfaces that are there"


def test_unknown_frames_are_counted_and_change_nothing(leg):
    with simulator(leg) as sim, daemon(leg) as torqued:
        send("vcan0", 0x7AA, b"who?", count=7)
        send("vcan1", 0x80000101 | 0x7A000, b"", count=2)
        send("vcan0", 0x101, b"short", count=5)
        time.sleep(0.5)  # for some cycles more
        report = torqued.terminate()
        robot = sim.terminate()
    assert report["events"]["frame_unknown_id"] == 9
    assert report["events"]["frame_wrong_length"] == 5
    assert report["fault"] == 0
    assert robot["frames_unknown"] == 9


def test_robot_without_answers_is_a_latched_fault(leg):
    with simulator(leg) as sim, daemon(leg) as torqued:
        torqued.wait_for("state: holding")
        sim.send(signal.SIGSTOP)
        torqued.wait_for("FAULT 104 joint_stale")
        sim.send(signal.SIGCONT)
        time.sleep(0.5)  # answers come again; the fault stays
        report = torqued.terminate(code=1)
        sim.terminate()
    assert report["events"]["joint_stale"] >= 1
    assert report["events"]["joint_missed"] > 0
    assert report["fault"] == 104
