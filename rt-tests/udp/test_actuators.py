"""From power-on to holding with actuators, by frames of their makers' own."""

import re
import signal
import subprocess
import time

import pytest
import results
import torqued
from actuators import TIME_OUT_S, Cubemars, Damiao, Line, Moteus, Myactuator, Odrive, Robstride
from processes import BINARIES, Process, daemon, forget_faults
from test_canopen import configuration, enable_once_plausible, to_holding, wait_for_state

KP, KD = 100.0, 3.0
NODES = {3: 0.5, 4: -0.3}


#: ODrive sends by a clock of its own; the frames of moteus are those of CAN FD.
OF_FAMILY = {
    "moteus": [(r'kind = "udp_multicast"', 'kind = "udp_multicast"\nfd = true')],
    "odrive": [(r"gear_ratio = 10.0", 'gear_ratio = 10.0\nsampled = "when_sent"\nperiod_us = 4000')],
}


def changes(family, model):
    actuator = (
        f'profile = "{family}"\n[drive.joint.actuator]\nmodel = "{model}"\n'
        f"kp_Nm_per_rad = {KP}\nkd_Nms_per_rad = {KD}\n"
    )
    return [
        (r'profile = "cia402"\n\[drive\.joint\.canopen\]\n(?:.+ = .*\n)+', actuator),
        (r'law = "predictive"\ntorque_feedback = "torsion"', 'law = "proportional_integral"\ntorque_feedback = "whole_body"'),
        (r"gear_ratio = .*", "gear_ratio = 10.0"),
        (r"K_tau_rad_per_Nm = .*", f"K_tau_rad_per_Nm = {1 / KP}"),
        (r"dead_zone_rad = .*", "dead_zone_rad = 0.002"),
        (r"torque_limit_Nm = .*", "torque_limit_Nm = 8.0"),
        *OF_FAMILY.get(family, []),
        (r"gains = .*", "gains = { K_p = 0.0, K_i_per_s = 0.0, K_s_Nm_per_rad = 20.0, K_d_Nms_per_rad = 2.0 }"),
    ]


FAMILIES = {
    "cubemars": (Cubemars, "AK70-10"),
    "damiao": (Damiao, "DM4310"),
    "moteus": (Moteus, "moteus"),
    "myactuator": (Myactuator, "RMD-T24"),
    "odrive": (Odrive, "ODrive"),
    "robstride": (Robstride, "RS02"),
}


@pytest.fixture(params=FAMILIES)
def robot(request, tmp_path):
    kind, model = FAMILIES[request.param]
    line = Line(kind, NODES)
    yield configuration(tmp_path, changes(request.param, model)), line
    line.end()


def test_from_power_on_to_holding(robot):
    config, actuators = robot[0], robot[1].actuators
    starts = [actuator.q for actuator in actuators]
    with daemon(config, "--accept-margins") as process:
        to_holding()
        time.sleep(1.0)
        assert all(actuator.enabled for actuator in actuators)
        report = process.terminate()
    assert report["fault"] == 0
    # Whatever an actuator answers, it is known.
    assert "frame_unknown_id" not in report["events"]
    for actuator, start in zip(actuators, starts):
        assert not actuator.enabled and "enable" in actuator.words and actuator.words[-1] == "disable"
        # Nothing but questions and physical zero before it was enabled.
        assert not actuator.while_off
        position, target = actuator.first
        assert abs(target - position) < 2e-3
        assert abs(actuator.q - start) < 5e-3
        if isinstance(actuator, Damiao):
            # What PyPI damiao-motor reads in its answers.
            assert abs(actuator.read["pos"] - actuator.q) < 2e-3
        if isinstance(actuator, Moteus):
            # And PyPI moteus.
            assert actuator.read.id == actuator.id and actuator.read.values


@pytest.mark.parametrize("act", ["killed", "pulled"])
def test_they_stop_when_the_daemon_is_killed_or_the_bus_pulled(robot, act, request):
    config, line = robot
    with daemon(config, "--accept-margins") as process:
        to_holding()
        kill = lambda: process.send(signal.SIGKILL)
        ms = results.stop_ms(kill if act == "killed" else line.pull, line.actuators)
        # Its time-out, from the last command that it heard; and what a busy machine may add.
        assert all(a.stopped_after is not None and a.stopped_after >= TIME_OUT_S for a in line.actuators)
    assert ms / 1000 < TIME_OUT_S + 0.3
    family = request.node.callspec.params["robot"]
    results.TABLES["stops"].append((family, round(1000 * TIME_OUT_S), act, ms))


#: Those whose commands hold their gains.
bearing = pytest.mark.parametrize("robot", ["cubemars", "damiao", "robstride", "moteus"], indirect=True)


def load(actuator):
    """Up to 1.9 N·m, slowly."""
    for k in range(20):
        actuator.load = 0.1 * k
        time.sleep(0.05)
    time.sleep(0.5)


@bearing
def test_one_whose_encoder_slips_bears_its_load(robot):
    """No brake would hold it: it goes on with its torque of before, until an operator disables it."""
    config, line = robot
    slips, other = line.actuators
    with daemon(config, "--accept-margins"):
        client = to_holding()
        load(slips)
        held = slips.q
        slips.slip = 0.1
        wait_for_state(client, torqued.RobotState.FAULT)
        time.sleep(1.0)
        p, v, kp, kd, torque = slips.command
        assert slips.enabled and kp == 0.0 and abs(torque - slips.load) < 0.5, slips.command
        assert abs(slips.q - held) < 0.3
        assert other.enabled and other.command[2] > 0.0
        client.disable()
        time.sleep(0.5)
        assert not slips.enabled and not other.enabled


@bearing
def test_one_whose_torque_pushes_the_other_way_is_switched_off(robot):
    """Its encoder slips on the rotor: its windings make the reverse of the torque that it reports, damping as well."""
    config, line = robot
    slips, other = line.actuators
    with daemon(config, "--accept-margins"):
        client = to_holding()
        load(slips)
        slips.commutation, slips.slip = -1.0, 0.1
        until = time.monotonic() + 3.0
        while slips.enabled and time.monotonic() < until:
            fastest = abs(slips.dq)
            time.sleep(0.001)
        wait_for_state(client, torqued.RobotState.FAULT)
        # A quarter of the velocity limit of 6 rad/s, and what it gains until that is seen.
        assert not slips.enabled and fastest < 2.0, fastest
        assert other.enabled and other.command[2] > 0.0


@pytest.fixture
def odrives(tmp_path):
    line = Line(Odrive, NODES)
    yield configuration(tmp_path, changes("odrive", "ODrive")), line.actuators
    line.end()


def test_an_error_is_named_in_words_and_the_drive_comes_back(odrives):
    config, actuators = odrives
    with daemon(config, "--accept-margins") as process:
        client = to_holding()
        actuators[0].disable()
        actuators[0].error = 0x2000
        process.wait_for(r"joint \(node 3\): error 0x2000, motor too hot")
        record = wait_for_state(client, torqued.RobotState.FAULT)
        assert record.cycle.fault
        assert actuators[1].enabled, "the other joints hold"
        # An operator acknowledges: its error is cleared, and it is enabled where it stands.
        client.acknowledge(record.cycle.fault)
        process.wait_for(r"joint \(node 3\): no error any more")
        enable_once_plausible(client)
        wait_for_state(client, torqued.RobotState.HOLDING)
        assert not actuators[0].error and actuators[0].enabled
        assert process.terminate()["fault"] == 0


def test_what_an_odrive_does_not_send_is_named(odrives):
    config, actuators = odrives
    actuators[1].tells_current = False
    forget_faults()
    with Process(BINARIES / "torqued", "run", config, "--accept-margins") as process:
        process.wait_for(r"second \(node 4\): no current: set `axis0.config.can.iq_msg_rate_ms`")
        client = torqued.Client("test-joint", timeout_s=10.0)
        assert next(iter(client.records(10.0))).cycle.state == torqued.RobotState.BOOT
        assert not any(actuator.enabled for actuator in actuators)


def test_damiao_and_odrive_share_no_bus(tmp_path):
    """The question to a Damiao is an ODrive's order to enter its firmware loader."""
    config = configuration(tmp_path, changes("damiao", "DM4310"))
    text = config.read_text()
    sections = [part for part in re.split(r"(?m)^(?=\[)", text) if part.startswith("[drive.joint")]
    other = "".join(sections).replace("[drive.joint", "[drive.other")
    other = other.replace('"damiao"', '"odrive"').replace('"DM4310"', '"ODrive"')
    head, tail = text.rsplit('drive = "joint"', 1)
    config.write_text(head + 'drive = "other"' + tail + "\n" + other)
    done = subprocess.run([BINARIES / "torquectl", "check", config], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "is on this bus as well: questions to Damiao's actuators have the identifier 0x7FF" in done.stderr, done.stderr
