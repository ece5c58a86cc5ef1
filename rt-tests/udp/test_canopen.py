"""From power-on to holding with drives of other people's: python-canopen's LocalNodes behind the daemon."""

import json
import re
import signal
import subprocess
import time

import durand_drive
import pytest
import results
import torqued
import zencan_drive
from canopen_drive import Line
from processes import BINARIES, ROOT, Process, daemon, forget_faults

MODEL = ROOT / "config" / "test-joint" / "robot.toml"
URDF = ROOT / "robot-models" / "test-joint" / "robot.urdf"
BUS = """[[bus]]
name = "a"
kind = "udp_multicast"
"""
CANOPEN = """profile = "cia402"
[drive.joint.canopen]
position = "link"
other_angle = "2240:00"
rated_current_A = 5.0
heartbeat_ms = 300
vendor = 0x5A
sdo = [{ object = "6065:00", bits = 32, value = 100000 }]
"""
SECOND = """
[[joint]]
name = "second"
bus = "a"
drive = "joint"
torque_limit_Nm = 37.0
node = 4
gains = { K_s_Nm_per_rad = 2083.0, K_d_Nms_per_rad = 20.8 }
"""
CURRENT = """K_1_Nm_per_A = 5.0
K_2_Nms_per_rad = 0.5
K_3_Nm = 1.5
"""
NODES = [{"node": 3, "degrees": 30.0}, {"node": 4, "degrees": -20.0}]


def two_arms():
    """The test joint twice, on vertical axes."""
    urdf = URDF.read_text().replace('axis xyz="0 1 0"', 'axis xyz="0 0 1"')
    base, arm = re.search(r'(.*</link>\s*)(<joint name="joint".*)</robot>', urdf, re.S).groups()
    second = re.sub(r'"(joint|link|tip_load_mount|tip_load)"', r'"second_\1"', arm)
    return base + arm + second.replace('"second_joint"', '"second"') + "</robot>\n"


def configuration(folder, changes=(), joints=2):
    """That many test joints with CANopen drives: no DBC file, one line for a joint."""
    text = MODEL.read_text() + (SECOND if joints == 2 else "")
    urdf = two_arms() if joints == 2 else URDF.read_text().replace('axis xyz="0 1 0"', 'axis xyz="0 0 1"')
    (folder / "robot.urdf").write_text(urdf)
    signals = r"motor_angle = .*\nlink_angle = .*\ncurrent = .*\nstatus = .*\nset_point = .*\ncontrol = .*\n"
    for pattern, new in (
        (r'urdf = ".*"', 'urdf = "robot.urdf"'),
        (r"\[\[bus\]\]\n(?:.+\n)+", BUS),
        (r"rate_hz = .*", "rate_hz = 200.0"),
        # Python's drives answer as the machine lets them.
        (r"stale_after_ms = .*", "stale_after_ms = 250.0"),
        (r"gather_deadline_us = .*", "gather_deadline_us = 4000.0"),
        (r"window = 80", "window = 16"),
        (r"motor_counts_per_turn = .*", "motor_counts_per_turn = 65536"),
        (r"\[drive\.joint\.state\]\nprofile = \"cia402\"\n", CANOPEN),
        (signals, "node = 3\n"),
        (r"kinematic_error = .*\n", ""),
        *changes,
    ):
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    path = folder / "robot.toml"
    path.write_text(text)
    return path


@pytest.fixture
def line(request):
    made = Line(getattr(request, "param", NODES))
    yield made
    made.end()


def wait_for_state(client, state, limit_s=30.0):
    until = time.monotonic() + limit_s
    for record in client.records(10.0):
        if record.cycle.state == state:
            return record
        assert time.monotonic() < until, f"state {record.cycle.state}, fault {record.cycle.fault}"


def to_holding():
    client = torqued.Client("test-joint", timeout_s=10.0)
    wait_for_state(client, torqued.RobotState.HOLDING)
    return client


CST = [
    (r'command = "position"\n', 'command = "current"\ncurrent_limit_A = 8.0\n'),
    (r"K_tau_rad_per_Nm = .*\nK_v_s = .*\nK_c_rad = .*\ndead_zone_rad = .*\n", CURRENT),
]


@pytest.mark.parametrize("mode, changes", [(8, []), (10, CST)], ids=["csp", "cst"])
def test_from_power_on_to_holding(tmp_path, line, mode, changes):
    starts = [drive.degrees for drive in line.drives]
    with daemon(configuration(tmp_path, changes), "--accept-margins") as process:
        to_holding()
        time.sleep(1.0)
        for drive in line.drives:
            assert drive.enabled and drive.operational
        report = process.terminate()
    assert report["fault"] == 0
    for drive, start in zip(line.drives, starts):
        # Resets, then start: nothing else was told to the node.
        assert set(drive.nmt[:-1]) == {0x82} and drive.nmt[-1] == 0x01
        assert not drive.aborts
        # No jump by a target of zero.
        position, target = drive.enabled_at
        assert abs(target - (position if mode == 8 else 0.0)) < 0.01
        assert abs(drive.degrees - start) < 0.1
        assert drive.worst_jump < 1e-3
        assert (drive.number(0x6061), drive.number(0x6065)) == (mode, 100000)
        assert drive.number(0x1016, 1) == 127 << 16 | 300
        assert drive.heartbeats > 5
        assert drive.number(0x1403, 1) >> 31, "what is not used is off"


@pytest.fixture
def other_stack(request):
    made = request.param(NODES)
    yield made
    made.end()


@pytest.mark.parametrize(
    "other_stack, name, mode, changes, act",
    [
        (durand_drive.Line, "durand", 8, [], "killed"),
        (durand_drive.Line, "durand", 10, CST, "pulled"),
        (zencan_drive.Line, "zencan-node", 8, [], "killed"),
        (zencan_drive.Line, "zencan-node", 10, CST, "pulled"),
    ],
    ids=["durand-csp-killed", "durand-cst-pulled", "zencan-csp-killed", "zencan-cst-pulled"],
    indirect=["other_stack"],
)
def test_another_stack_from_power_on_to_holding_and_its_end(tmp_path, other_stack, name, mode, changes, act):
    """Drives of other stacks: set up, held, and stopped by themselves when the daemon is killed or the bus pulled."""
    drives = other_stack.drives
    starts = [drive.degrees for drive in drives]
    with daemon(configuration(tmp_path, changes), "--accept-margins") as process:
        to_holding()
        time.sleep(1.0)
        assert all(drive.enabled and drive.operational for drive in drives)
        kill = lambda: process.send(signal.SIGKILL)
        ms = results.stop_ms(kill if act == "killed" else other_stack.pull, drives)
    assert ms / 1000 < 0.45 and all(drive.stopped_after >= 0.3 for drive in drives)
    results.TABLES["stops"].append((f"cia402, {name}", 300, act, ms))
    for drive, start in zip(drives, starts):
        assert drive.operational
        assert (drive.value(0x6061), drive.value(0x6065)) == (mode, 100000)
        assert drive.value(0x1016, 1) == 127 << 16 | 300
        position, target = drive.enabled_at
        assert abs(target - (position if mode == 8 else 0.0)) < 0.01
        assert drive.worst_jump < 1e-3 and abs(drive.degrees - start) < 0.1


@pytest.mark.parametrize("act", ["killed", "pulled"])
def test_the_drives_stop_when_the_daemon_is_killed_or_the_bus_pulled(tmp_path, line, act):
    with daemon(configuration(tmp_path, CST), "--accept-margins") as process:
        to_holding()
        kill = lambda: process.send(signal.SIGKILL)
        ms = results.stop_ms(kill if act == "killed" else line.pull, line.drives)
    # The time after which the drive counts the daemon as lost, from the last heartbeat that it heard.
    assert all(drive.stopped_after is not None and drive.stopped_after >= 0.3 for drive in line.drives)
    assert ms / 1000 < 0.45
    results.TABLES["stops"].append(("cia402", 300, act, ms))


def enable_once_plausible(client, limit_s=10.0):
    """Enables the robot; a joint that was silent must first send plausible samples for a while."""
    until = time.monotonic() + limit_s
    while True:
        try:
            return client.enable()
        except torqued.RefusedError as refused:
            assert "plausible" in str(refused) and time.monotonic() < until
            time.sleep(0.1)


def test_a_drive_that_starts_anew_is_named_withdrawn_and_set_up_anew(tmp_path, line):
    changes = [(r'enable = "automatic"', 'enable = "operator"')]
    with daemon(configuration(tmp_path, changes), "--accept-margins") as process:
        client = torqued.Client("test-joint", timeout_s=10.0)
        wait_for_state(client, torqued.RobotState.READY)
        client.enable()
        wait_for_state(client, torqued.RobotState.HOLDING)
        drive, other = line.drives
        drive.fail(0x4310)
        process.wait_for(r"joint \(node 3\): emergency 4310, motor or heat sink too hot")
        # Its first answers are lost: the next set-up has to come without another word of it.
        drive.lose = range(drive.answers + 1, drive.answers + 5)
        drive.power_on()
        process.wait_for(r"joint \(node 3\) has started anew: its joint is withdrawn")
        process.wait_for(r"no answer in time.*tried again")
        process.wait_for(r"joint \(node 3\) is set up anew, and off")
        record = wait_for_state(client, torqued.RobotState.FAULT)
        assert record.cycle.fault and not drive.enabled and other.enabled
        assert drive.operational and drive.number(0x1016, 1) == 127 << 16 | 300
        client.acknowledge(record.cycle.fault)
        enable_once_plausible(client)
        wait_for_state(client, torqued.RobotState.HOLDING)
        assert drive.enabled and other.enabled
        assert process.terminate()["fault"] == 0
    assert max(drive.worst_jump for drive in line.drives) < 1e-3


def test_a_drive_that_hears_no_control_words_is_reset(tmp_path, line):
    changes = [(r'enable = "automatic"', 'enable = "operator"')]
    with daemon(configuration(tmp_path, changes), "--accept-margins") as process:
        client = torqued.Client("test-joint", timeout_s=10.0)
        wait_for_state(client, torqued.RobotState.READY)
        client.enable()
        wait_for_state(client, torqued.RobotState.HOLDING)
        drive, other = line.drives
        drive.deaf = True
        client.disable()
        process.wait_for(r"joint \(node 3\) has started anew")
        assert 0x81 in drive.nmt and 0x81 not in other.nmt
        assert not drive.enabled and not other.enabled
        process.terminate()


@pytest.mark.parametrize(
    "line, said",
    [
        ([{"vendor": 0x77}], ["joint (node 3 on bus a)", "1018:01", "maker is 0x77 instead of 0x5a"]),
        ([{"refuse": (0x6065, 0)}], ["object 6065:00", "outside the allowed range (06090030)"]),
        ([{"refuse": (0x1A01, 1)}], ["mapping of process data", "object 1A01:01"]),
        ([{"forget": (0x1A01, 1)}], ["mapping of process data", "1A01:01 reads back"]),
        ([{"node": 4}], ["joint (node 3 on bus a)", "no boot-up"]),
        ([{"lose": range(9, 999)}], ["joint (node 3 on bus a)", "no answer in time"]),
        ([{"cut": 9}], ["joint (node 3 on bus a)", "the node has started anew while it was set up"]),
        # Of 5 A and 5 N·m/A.
        ([{"torque": 800}], ["object 6072:00", "the drive allows 20.0000 N·m, torque_limit_Nm is 37.0000 N·m"]),
    ],
    ids=[
        "other maker",
        "SDO abort",
        "mapping refused",
        "mapping not taken",
        "node absent",
        "node falls silent",
        "power cut or reset of the node",
        "a limit below the joint's",
    ],
    indirect=["line"],
)
def test_what_is_not_as_planned_is_named_and_nothing_moves(tmp_path, line, said, request):
    (drive,) = line.drives
    not_as_planned(tmp_path, drive, said, request.node.callspec.id)


def not_as_planned(tmp_path, drive, said, case):
    start = drive.degrees
    forget_faults()
    config = configuration(tmp_path, joints=1)
    with Process(BINARIES / "torqued", "run", config, "--json", "--accept-margins") as process:
        assert process.wait(60.0) == 1
        output = process.output()
    for part in said:
        assert part in output, output
    assert not drive.enabled and drive.degrees == start
    named = next(text for text in output.splitlines() if "joint (node 3 on bus a)" in text)
    # Without the time and level of a message.
    named = re.sub(r"^\S+Z [A-Z]+ +", "", named.strip()).removeprefix("torqued: ")
    results.TABLES["set-up"].append((case, named))


@pytest.mark.parametrize("line", [[{}]], indirect=True)
def test_two_nodes_with_one_id_are_not_as_planned(tmp_path, line):
    second = Line([{}])
    try:
        not_as_planned(tmp_path, line.drives[0], ["two nodes have this id"], "two nodes with one id")
    finally:
        second.end()


@pytest.mark.parametrize("line", [[{"torque": 3000}]], indirect=True)
def test_a_limit_far_above_the_joints_is_a_warning(tmp_path, line):
    config = configuration(tmp_path, joints=1)
    dry = [BINARIES / "torquectl", "can", "setup", "--dry-run", config, "--json"]
    read = json.loads(subprocess.run(dry, capture_output=True, text=True, check=True, timeout=60).stdout)
    (note,) = [note for note in read["nodes"][0]["notes"] if "6072" in note]
    assert "the drive allows 75.0000 N·m, torque_limit_Nm is 37.0000 N·m" in note
    with daemon(config, "--accept-margins") as process:
        to_holding()
        assert note in process.output()
        assert process.terminate()["fault"] == 0


@pytest.mark.parametrize("line", [[{"lose": (9, 20)}]], indirect=True)
def test_a_lost_frame_is_made_good(tmp_path, line):
    with daemon(configuration(tmp_path, joints=1), "--accept-margins") as process:
        to_holding()
        assert process.terminate()["fault"] == 0
    assert line.drives[0].answers > 20
    results.TABLES["set-up"].append(("two lost frames", "nothing: each is asked for again; holds"))
