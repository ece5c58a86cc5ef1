"""The Python client against the Rust end of shared memory, in processes of their own.

The client crate's example `stand_in_daemon` publishes joint torques `j + sin t` at 1 kHz and
follows references.
"""

import asyncio
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from processes import example

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / "client" / "python"
sys.path.insert(0, str(PYTHON))

import torqued  # noqa: E402

pytestmark = pytest.mark.real_time

PATIENCE_S = 10.0
JOINTS = 6


@pytest.fixture(scope="module")
def program():
    return example("stand_in_daemon")


@pytest.fixture
def run_dir(tmp_path, monkeypatch):
    monkeypatch.setenv("TORQUED_RUN_DIR", str(tmp_path))
    yield tmp_path
    prefix = torqued.location._prefix(tmp_path.resolve())
    for leftover in Path("/dev/shm").glob(f"{prefix}*"):
        leftover.unlink()


@pytest.fixture
def daemons(program, run_dir):
    """Starts daemons; ends those that still run."""
    started = []

    def start():
        daemon = subprocess.Popen([program, "leg"], stdout=subprocess.PIPE, text=True)
        started.append(daemon)
        assert daemon.stdout.readline() == "publishing leg\n"
        return daemon

    yield start
    for daemon in started:
        kill(daemon)


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.wait()


def wait_for(client, condition):
    for record in client.records(PATIENCE_S):
        if condition(record):
            return record


def start_python(code):
    environment = os.environ | {"PYTHONPATH": str(PYTHON)}
    return subprocess.Popen([sys.executable, "-c", code], env=environment)


def test_a_stream_lets_other_tasks_run_and_says_when_the_daemon_is_gone(daemons):
    daemon = daemons()
    client = torqued.Client("leg", PATIENCE_S)

    async def other(turns):
        while True:
            turns.append(1)
            await asyncio.sleep(0.001)

    async def both():
        turns, sequences = [], []
        task = asyncio.create_task(other(turns))
        async for record in client.stream(PATIENCE_S):
            sequences.append(record.cycle.sequence)
            if len(sequences) == 300:
                break
        lost = client.lost
        kill(daemon)
        with pytest.raises(torqued.NoDaemonError, match="no record for 0.5 s"):
            async for record in client.stream(0.5):
                pass
        task.cancel()
        return len(turns), sequences, lost

    turns, sequences, lost = asyncio.run(both())
    assert sequences[-1] - sequences[0] == len(sequences) - 1 + lost
    assert turns > 50


def test_every_record_arrives_as_it_was_sent(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    assert client.joint_names == [f"joint_{j}" for j in range(JOINTS)]
    assert client.description.rate_hz == 1000.0
    first = client.next_record(PATIENCE_S).cycle.sequence
    for sequence in range(first + 1, first + 500):
        record = client.next_record(PATIENCE_S)
        assert record.cycle.sequence == sequence
        # The record's far end too: a field in the wrong place would be seen.
        assert record.timing.cycles == sequence
        for j, joint in enumerate(record.cycle.estimated.joints[:JOINTS]):
            assert joint.tau_whole_body.tau == pytest.approx(j + math.sin(sequence * 1e-3), abs=1e-12)
            assert torqued.TorqueSource(joint.tau_whole_body.source) == torqued.TorqueSource.WHOLE_BODY
            assert joint.tau_whole_body.flags & torqued.TorqueFlags.VALID
    assert client.lost == 0


def test_numpy_reads_all_joints_at_once(daemons):
    daemons()
    record = torqued.Client("leg", PATIENCE_S).next_record(PATIENCE_S)
    tau = np.ctypeslib.as_array(record.cycle.estimated.joints)["tau_encoder"]["tau"][:JOINTS]
    assert np.allclose(np.diff(tau), 1.0)


def test_a_slow_client_counts_lost_records(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    client.next_record(PATIENCE_S)
    other = torqued.Client("leg", PATIENCE_S)
    wait_for(other, lambda record: record.cycle.sequence > client._newest_sequence + 400)
    before = client._newest_sequence
    received = 1
    while client.next_record(PATIENCE_S).cycle.sequence < before + 400:
        received += 1
    assert client.lost > 0
    assert client._newest_sequence - before == client.lost + received


class Sending:
    """A commander that goes on sending its reference, in a thread."""

    def __init__(self, commander):
        self.commander = commander
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.ended.wait(0.005):
            self.commander.send()

    def __enter__(self):
        self.thread.start()

    def __exit__(self, *_):
        self.ended.set()
        self.thread.join()


def test_references_move_the_robot_until_the_block_ends(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    with torqued.Commander(client) as commander:
        assert commander.reference.joint_count == JOINTS
        assert commander.status.commander.session == commander.reference.session

        def change(reference):
            reference.mode = torqued.Mode.INVERSE_DYNAMICS
            reference.joints[3].q_d = 0.75
            reference.joints[5].tau_d = -4.5

        commander.send(change)
        record = wait_for(client, lambda r: r.cycle.mode == torqued.Mode.INVERSE_DYNAMICS)
        assert record.cycle.measured.joints[3].q == 0.75
        assert record.cycle.commanded.joints[5].tau_d == -4.5
        with Sending(commander):
            with pytest.raises(torqued.AlreadyCommandedError, match=rf"process {os.getpid()} "):
                torqued.Commander(torqued.Client("leg", PATIENCE_S))
    wait_for(client, lambda r: r.cycle.mode == torqued.Mode.HOLD)
    # The next one begins where the robot stands.
    with torqued.Commander(client) as commander:
        assert commander.reference.mode == torqued.Mode.HOLD
        assert [joint.q_d for joint in commander.reference.joints[2:5]] == [0.0, 0.75, 0.0]
        wait_for(client, lambda r: r.cycle.measured.joints[3].q == 0.75)


def back_and_forth(size):
    """Of one second, for all joints: at rest at both ends."""

    def at(t):
        u, du = t * (1 - t), 1 - 2 * t
        k = 64 * size
        point = (k * u**3, 3 * k * u**2 * du, k * (6 * u * du**2 - 6 * u**2))
        return [point] * JOINTS

    return at


def test_a_trajectory_is_sent_ahead_and_followed(daemons):
    daemons()
    client = torqued.Client("leg")
    with torqued.Commander(client) as commander:
        commander.hold_until_ready(PATIENCE_S)
        shown, places = [], []

        def going(progress):
            shown.append(progress)
            client.latest()  # those from before
            places.append(client.next_record().cycle.measured.joints[2].q)
            # A program that does something else for a while.
            time.sleep(0.1)
            return True

        assert commander.follow(1.0, back_and_forth(0.2), going=going)
        assert 0.15 < max(places) < 0.201
        assert shown[-1].time_s > 0.9 and max(p.buffered_s for p in shown) > 0.2
        # Beyond the limits of position; stopped on the way; ended in motion.
        with pytest.raises(torqued.TrajectoryError, match="LIMIT"):
            commander.follow(1.0, back_and_forth(1.5))
        assert not commander.follow(
            1.0, back_and_forth(0.2), going=lambda progress: progress.time_s < 0.3
        )
        with pytest.raises(torqued.TrajectoryError, match="ended in motion"):
            commander.follow(0.3, back_and_forth(0.2))


def test_the_readmes_trajectory_reaches_its_end(daemons):
    blocks = (PYTHON / "README.md").read_text().split("```python\n")[1:]
    (block,) = [block for block in blocks if "commander.follow(" in block]
    daemons()
    names = dict(vars(math), torqued=torqued, client=torqued.Client("leg"))
    exec(block.split("```")[0].replace("commander.follow(", "reached = commander.follow("), names)
    assert names["reached"]


def test_joints_are_let_go(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    with torqued.Commander(client) as commander:
        commander.hold_until_ready(PATIENCE_S)
        for _ in range(20):
            commander.let_go(["joint_3"])
            time.sleep(0.005)
        client.latest()  # those from before
        assert client.next_record().cycle.mode == torqued.Mode.PASSIVE
        assert commander.reference.held_joints == (1 << 64) - 1 - (1 << 3)
        with pytest.raises(KeyError, match="elbow"):
            commander.let_go(["elbow"])


@pytest.mark.parametrize("meanwhile", torqued.Meanwhile)
def test_a_program_that_computes_keeps_the_command(daemons, meanwhile):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    with torqued.Commander(client) as commander:
        commander.hold_until_ready(PATIENCE_S)
        commander.keep(1.0, meanwhile)

        def lead(reference):
            reference.mode = torqued.Mode.INVERSE_DYNAMICS
            reference.joints[0].q_d, reference.joints[0].dq_d = 0.0, 1.0

        commander.send(lead)
        session = commander.reference.session
        # Ten times the time-out of references: one that the interpreter shares, one that gives its lock up.
        until = time.monotonic() + 0.2
        while time.monotonic() < until:
            math.sqrt(2.0)
        time.sleep(0.2)
        assert commander.reference.joints[0].q_d == 0.0, "the program's own reference is not changed"
        commander.send(lead)
        assert commander.reference.session == session
        assert commander.status.commander.session == session


def test_a_program_that_hangs_loses_the_command_that_a_thread_keeps(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    commander = torqued.Commander(client)
    commander.hold_until_ready(PATIENCE_S)
    commander.keep(0.1)
    commander.reference.mode = torqued.Mode.TORQUE
    commander.send()
    time.sleep(0.5)
    with pytest.raises(torqued.CommandLostError):
        commander.send()
    commander.close()


def test_a_commander_of_higher_priority_takes_over(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    with torqued.Commander(client, priority=1) as first:
        first.send()
        with torqued.Commander(torqued.Client("leg", PATIENCE_S), priority=2) as second:
            with Sending(second):
                with pytest.raises(torqued.AlreadyCommandedError, match="priority 2"):
                    first.send()
        first.hold_until_ready(PATIENCE_S)
        first.reference.mode = torqued.Mode.TORQUE
        first.send()


def test_references_that_are_not_followed_raise(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    with torqued.Commander(client) as commander:

        def torque():
            commander.reference.mode = torqued.Mode.TORQUE
            for _ in range(100):
                commander.send()
                time.sleep(0.002)

        torque()
        # Enabled twice, this daemon latches a fault.
        client.enable()
        with pytest.raises(torqued.NotFollowedError, match="fault 404 enable_time_out"):
            torque()
        with pytest.raises(torqued.NotFollowedError, match="404"):
            commander.hold_until_ready(0.05)
        client.acknowledge(404)
        with pytest.raises(torqued.NotFollowedError, match="in state ready"):
            torque()
        client.enable()
        commander.hold_until_ready(PATIENCE_S)
        torque()
        time.sleep(0.5)  # longer than the time-out
        with pytest.raises(torqued.CommandLostError, match="ask for mode hold"):
            commander.send()
        commander.reference.mode = torqued.Mode.HOLD
        commander.send()
        torque()


@pytest.mark.parametrize("record", [torqued.Reference, torqued.SharedRecord, torqued.Request])
def test_a_misspelt_field_is_an_error(record):
    with pytest.raises(AttributeError):
        record().qd = 1.0
    with pytest.raises(AttributeError):
        torqued.Reference().joints[0].qd = 1.0
    with pytest.raises(AttributeError):
        torqued.Reference(joint_cout=6)


def test_a_killed_commander_makes_room(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    holder = start_python(
        "import torqued; client = torqued.Client('leg', 10); commander = torqued.Commander(client)\n"
        "commander.reference.mode = torqued.Mode.TORQUE\n"
        "for record in client.records(10): commander.send()"
    )
    wait_for(client, lambda r: r.cycle.mode == torqued.Mode.TORQUE)
    kill(holder)
    wait_for(client, lambda r: r.cycle.mode == torqued.Mode.HOLD)
    torqued.Commander(client).send()


def test_a_tare_is_answered_with_offsets(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    assert client.contact_set_names == ["in_the_air", "standing"]
    seen = []
    kind = torqued.RequestKind.TARE
    answer = client.request(kind, "in_the_air", lambda a: seen.append(a.progress))
    assert seen == [0.25, 0.5, 0.75]
    assert list(answer.ft[0].offset.force) == [1.0, 2.0, 3.0]
    assert list(answer.ft[0].offset.torque) == [4.0, 5.0, 6.0]
    assert answer.ft[0].known == 0b111111
    assert answer.date_unix_s == 1.7e9
    assert list(client.tare("in_the_air").ft[0].offset.torque) == [4.0, 5.0, 6.0]


def test_a_refusal_is_raised_with_its_reason(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    with pytest.raises(torqued.RefusedError, match="no moon; allowed: in_the_air, standing"):
        client.tare("moon")
    with pytest.raises(torqued.RefusedError):
        client.choose_contact_set("ä" * 100)


def test_contacts_are_chosen(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    client.choose_contact_set("standing")
    wait_for(client, lambda r: r.cycle.estimated.contact_set == 1)
    client.automatic_contact_set()
    wait_for(client, lambda r: r.cycle.estimated.contact_set_automatic == 1)


def test_an_operator_enables_stops_and_acknowledges(daemons):
    daemons()
    client = torqued.Client("leg", PATIENCE_S)
    state = torqued.RobotState
    for ask, then in [
        (client.disable, state.READY),
        (client.enable, state.HOLDING),
        (client.stop, state.HOLDING),
        (client.enable, state.FAULT),
    ]:
        assert torqued.text(ask().text) == then.name.lower()
        record = wait_for(client, lambda r: r.cycle.state == then)
    assert record.cycle.fault == 404
    with pytest.raises(torqued.RefusedError, match="fault 404 is latched, not 104"):
        client.acknowledge(104)
    with pytest.raises(torqued.RefusedError, match="acknowledge the fault first"):
        client.enable()
    client.acknowledge(404)
    wait_for(client, lambda r: r.cycle.state == state.READY and r.cycle.fault == 0)


def test_a_request_to_a_daemon_that_is_gone_is_an_error(daemons):
    daemon = daemons()
    client = torqued.Client("leg", PATIENCE_S)
    kill(daemon)
    with pytest.raises(torqued.NoDaemonError):
        client.tare("in_the_air")


def test_a_client_goes_on_with_the_next_daemon(daemons):
    daemon = daemons()
    client = torqued.Client("leg", PATIENCE_S)
    wait_for(client, lambda r: r.cycle.sequence > 300)
    kill(daemon)
    with pytest.raises(torqued.NoDaemonError, match="look at its log"):
        wait_until_no_record_comes(client)
    daemons()
    wait_for(client, lambda r: r.cycle.sequence < 300)
    assert client.description.joint_count == JOINTS


def wait_until_no_record_comes(client):
    while True:
        client.next_record(0.3)


def test_without_a_daemon_the_error_names_robot_and_directory(run_dir):
    with pytest.raises(torqued.NoDaemonError) as raised:
        torqued.Client("leg", timeout_s=0.1)
    for part in ("torqued/leg/description", str(run_dir), "start `torqued run"):
        assert part in str(raised.value)


def test_another_layout_is_refused(daemons, monkeypatch):
    daemons()
    other = staticmethod(lambda: "torqued::SharedRecord#00000000deadbeef")
    monkeypatch.setattr(torqued.SharedRecord, "type_name", other)
    with pytest.raises(torqued.OtherLayoutError, match="same version"):
        torqued.Client("leg", PATIENCE_S)


def test_a_directory_of_another_user_is_refused(monkeypatch):
    monkeypatch.setenv("TORQUED_RUN_DIR", "/proc/torqued")
    with pytest.raises(torqued.RunDirectoryError, match="TORQUED_RUN_DIR"):
        torqued.Client("leg", timeout_s=0.1)


def test_the_example_prints_torques(daemons):
    daemons()
    script = [sys.executable, PYTHON / "examples" / "01_print_torques.py", "leg", "1"]
    environment = os.environ | {"PYTHONPATH": str(PYTHON)}
    printed = subprocess.run(script, env=environment, capture_output=True, text=True, check=True).stdout
    assert printed.count("cycle ") >= 2
    assert printed.count("joint_5") == printed.count("cycle ")
    assert "joint_6" not in printed


def test_round_trips_of_a_reference_are_measured(daemons):
    daemons()
    script = [sys.executable, PYTHON / "examples" / "02_round_trip.py", "leg", "1"]
    environment = os.environ | {"PYTHONPATH": str(PYTHON)}
    found = json.loads(subprocess.run(script, env=environment, check=True, capture_output=True, text=True).stdout)
    assert found["records_per_s"] > 50 and 0.0 < found["p50_ms"] <= found["p99_ms"] <= found["max_ms"]
