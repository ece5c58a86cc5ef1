"""torquectl can: who is on a bus, what it says, its errors cleared, its set-up shown; by other people's ends."""

import json
import subprocess

import actuators
import canopen_drive
import pytest
from actuators import GROUP, PORT, Cubemars, Damiao, Moteus, Myactuator, Odrive, Robstride
from processes import BINARIES, ROOT
from test_canopen import configuration, two_arms

BUS = f"{GROUP}:{PORT}"
KINDS = {3: Damiao, 5: Moteus, 7: Robstride, 9: Myactuator, 21: Cubemars}


def torquectl(*arguments, code=0):
    command = [BINARIES / "torquectl", "can", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert done.returncode == code, f"{done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def scan(*arguments, code=0):
    found = json.loads(torquectl("scan", "--json", *arguments, code=code))["found"]
    return {(device["family"], device["node"]): device for device in found}


@pytest.fixture
def drives():
    made = canopen_drive.Line([{"node": 3}, {"node": 4}])
    yield made
    made.end()


@pytest.fixture
def line(request):
    made = actuators.Line(None, request.param)
    yield made
    made.end()


@pytest.mark.parametrize("line", [KINDS], indirect=True)
def test_actuators_are_found_and_nothing_moves(line):
    starts = [actuator.q for actuator in line.actuators]
    found = scan("--bus", BUS, "--fd")
    assert set(found) == {("damiao", 3), ("moteus", 5), ("robstride", 7), ("myactuator", 9)}
    assert found["damiao", 3]["reply_id"] == 0x13
    assert float(found["damiao", 3]["facts"]["torque_range_Nm"]) == 10.0
    assert (found["moteus", 5]["state"], found["moteus", 5]["on"]) == ("off", False)
    assert float(found["moteus", 5]["facts"]["position_rad"]) == pytest.approx(0.5, abs=1e-2)
    assert float(found["robstride", 7]["facts"]["position_rad"]) == pytest.approx(0.5)
    assert float(found["myactuator", 9]["facts"]["voltage_V"]) == 24.0
    for actuator, start in zip(line.actuators, starts):
        assert not actuator.enabled and not actuator.words and not actuator.while_off
        assert actuator.q == start


@pytest.mark.parametrize("line", [{48: Odrive, 9: Myactuator}], indirect=True)
def test_what_an_odrive_could_take_as_a_command_is_not_asked(line):
    odrive, _ = line.actuators
    odrive.error = 0x200
    # Enabled by whom ever: a target under its identifiers would move it.
    odrive.mode, odrive.gains = (3, 1), {"Vel_Gain": 0.2, "Pos_Gain": 20.0, "Vel_Integrator_Gain": 0.0}
    odrive.input = odrive.q * 10 / (2 * 3.141592653589793)
    before = odrive.mode, dict(odrive.gains), odrive.input
    text = torquectl("scan", "--bus", BUS)
    assert "0x200: supply's voltage too low" in text and "an ODrive 48 was heard" in text
    assert set(scan("--bus", BUS)) == {("odrive", 48), ("myactuator", 9)}
    assert (odrive.mode, odrive.gains, odrive.input) == before and not odrive.words


def test_drives_of_a_configuration_are_named_by_their_joints(tmp_path, drives):
    config = configuration(tmp_path)
    found = scan(config)
    assert {key: device["joint"] for key, device in found.items()} == {("cia402", 3): "joint", ("cia402", 4): "second"}
    assert found["cia402", 3]["facts"]["vendor"] == "0x5a"
    assert found["cia402", 3]["state"] == "switch on disabled"
    page = torquectl("show", 4, config)
    assert "joint second" in page and "rated_current_mA" in page and "5000" in page
    assert not any(drive.enabled or drive.operational for drive in drives.drives)


def test_a_fault_is_cleared_and_an_enabled_drive_is_left_alone(drives):
    drive, other = drives.drives
    drive.fail(0x4310)
    assert "fault" in scan("--bus", BUS)["cia402", 3]["state"]
    assert "now no error" in torquectl("clear", 3, "--bus", BUS)
    assert scan("--bus", BUS)["cia402", 3]["state"] == "switch on disabled"
    other._set(0x6041, 0, (0x27).to_bytes(2, "little"))
    refused = torquectl("clear", 4, "--bus", BUS, code=1)
    assert "is on (operation enabled): nothing is sent" in refused
    assert other.number(0x6040) == 0
    assert "nobody answers as 5" in torquectl("clear", 5, "--bus", BUS, code=1)


@pytest.mark.parametrize("line", [{5: Moteus}], indirect=True)
def test_a_fault_of_an_actuator_is_cleared(line):
    (moteus,) = line.actuators
    moteus.error, moteus.fault = 1, 35
    said = torquectl("clear", 5, "--bus", BUS, "--fd")
    assert "was 0x23: encoder; now no error" in said or "now no error" in said
    assert not moteus.error and not moteus.enabled


def test_a_set_up_is_shown_and_nothing_is_written(tmp_path, drives):
    config = configuration(tmp_path)
    before = [drive.number(0x1016, 1) for drive in drives.drives]
    page = torquectl("setup", "--dry-run", config)
    assert "1016:01 heartbeat of the daemon that it expects: 0x0 -> 0x7f012c" in page
    assert "second (node 4)" in page
    shown = json.loads(torquectl("setup", "--dry-run", config, "--json"))
    assert shown["as_planned"] and len(shown["nodes"][0]["written"]) > 10
    assert [drive.number(0x1016, 1) for drive in drives.drives] == before
    assert not any(drive.operational for drive in drives.drives)


def test_what_is_not_as_planned_is_named(tmp_path):
    line = canopen_drive.Line([{"node": 3, "vendor": 0x77}])
    try:
        page = torquectl("setup", "--dry-run", configuration(tmp_path, joints=1), code=1)
        assert "not as planned" in page and "maker is 0x77 instead of 0x5a" in page
    finally:
        line.end()


def test_bad_arguments_and_silent_buses():
    assert "Nobody answered" in torquectl("scan", "--bus", BUS, code=1)
    assert "GROUP:PORT" in torquectl("scan", "--bus", "10.0.0.1:43113", code=2)
    assert "--dry-run" in torquectl("setup", "robot.toml", code=2)


def new(folder, *arguments, code=0):
    command = [BINARIES / "torquectl", "new", "arm", "--urdf", "arm.urdf", "--scan", BUS, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=60)
    assert done.returncode == code, f"{done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def check(folder):
    command = [BINARIES / "torquectl", "check", "--json", "arm/robot.toml"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=60)
    assert done.returncode == 0, done.stderr
    return (folder / "arm" / "robot.toml").read_text()


OF_TWO = [{3: Damiao, 4: Damiao}, {5: Moteus, 7: Moteus}, {3: Odrive, 9: Robstride}, {2: Myactuator, 3: Myactuator}]


@pytest.mark.parametrize("line", OF_TWO, indirect=True)
def test_a_new_configuration_passes_check(tmp_path, line):
    (tmp_path / "arm.urdf").write_text(two_arms())
    said = new(tmp_path, "--fd")
    text = check(tmp_path)
    guessed = [line for line in text.splitlines() if line.endswith("# guessed")]
    assert len(guessed) >= 20 and f"{len(guessed)} lines end with `# guessed`" in said
    for actuator, joint in zip(sorted(line.actuators, key=lambda a: a.id), ("joint", "second")):
        table = text[text.index(f'[[joint]]\nname = "{joint}"') :]
        assert f"node = {actuator.id} # guessed" in table
        assert not actuator.words and not actuator.enabled
    if isinstance(line.actuators[0], Damiao):
        # Its registers tell its ranges.
        assert 'model = "DM4310"\n' in text and "reply_id = 19\n" in text
    assert "is there already" in new(tmp_path, code=2)


def test_a_new_configuration_of_canopen_drives(tmp_path, drives):
    (tmp_path / "arm.urdf").write_text(two_arms())
    new(tmp_path)
    text = check(tmp_path)
    assert "rated_current_A = 5.0\n" in text and "vendor = 0x5a\n" in text
    assert not any(drive.enabled or drive.operational for drive in drives.drives)


@pytest.mark.parametrize("line", [{3: Damiao}], indirect=True)
def test_a_joint_without_a_drive_is_refused(tmp_path, line):
    (tmp_path / "arm.urdf").write_text(two_arms())
    assert "1 drives answer, and the URDF has 2 joints" in new(tmp_path, code=1)
    assert not (tmp_path / "arm").exists()
    (tmp_path / "arm.urdf").write_text("<robot/>")
    assert "no joint that a drive moves" in new(tmp_path, code=2)
