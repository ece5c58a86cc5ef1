"""Wrong references and deaths of clients: counted, reported, and the robot holds its position."""

import math
import signal
import time

import pytest
import torqued
from processes import PYTHON, Process, daemon, simulator

JOINTS = 6


@pytest.fixture
def robot(leg):
    """The leg running on vcan, and a client that watches it."""
    with simulator(leg), daemon(leg) as process:
        yield process, torqued.Client("leg", timeout_s=10.0)


def record_where(client, holds, limit_s=10.0):
    """The first record from now on that meets a condition."""
    client.latest()
    until = time.monotonic() + limit_s
    while not holds(record := client.next_record(timeout_s=5.0)):
        assert time.monotonic() < until, f"mode {record.cycle.mode}, fault {record.cycle.fault}"
    return record


def set_points(cycle):
    """The commanded position of every joint, rad."""
    return [cycle.commanded.joints[j].q_c for j in range(JOINTS)]


def at_rest(client, limit_s=0.5):
    """The record from which on the set-points stand: a motion is brought to rest first, within
    `limit_s` and a degree."""
    begun = last = record_where(client, lambda r: r.cycle.mode == torqued.Mode.HOLD).cycle
    still = 0
    while still < 20:
        now = client.next_record(timeout_s=5.0).cycle
        still = still + 1 if set_points(now) == set_points(last) else 0
        for before, after in zip(set_points(begun), set_points(now)):
            assert abs(after - before) < math.radians(1.0), f"stopped over {after - before} rad"
        assert still or (now.stamp_ns - begun.stamp_ns) * 1e-9 < limit_s, "not at rest in time"
        last = now
    return last


def assert_holds(client, seconds=0.5):
    """Asserts that set-points come to rest, and that neither they nor joints move from then on."""
    first = at_rest(client)
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        now = client.next_record(timeout_s=5.0).cycle
        assert now.mode == torqued.Mode.HOLD
        for j in range(JOINTS):
            stepped = now.commanded.joints[j].q_c - first.commanded.joints[j].q_c
            assert abs(stepped) < 1e-9, f"set-point of joint {j} changed by {stepped} rad"
            moved = now.measured.joints[j].q - first.measured.joints[j].q
            assert abs(moved) < 2e-3, f"joint {j} moved by {moved} rad"


def count(record, name):
    """Number of occurrences of an event."""
    names = [event.name for event in torqued.EVENTS]
    return record.cycle.events[names.index(name)]


def test_nan_from_a_client_is_not_used(robot):
    process, client = robot
    with Process(PYTHON, "rt-tests/vcan/command.py", "leg", "nan") as commander:
        commander.wait_for("commanding")
        seen = record_where(client, lambda r: count(r, "reference_not_finite") > 0)
        assert seen.cycle.mode == torqued.Mode.HOLD
        assert_holds(client)
    report = process.terminate()
    assert report["events"]["reference_not_finite"] > 0
    assert report["fault"] == 0


def test_killed_client_leaves_the_robot_holding(robot):
    process, client = robot
    with Process(PYTHON, "rt-tests/vcan/command.py", "leg") as commander:
        commander.wait_for("commanding")
        record_where(client, lambda r: r.cycle.mode == torqued.Mode.INVERSE_DYNAMICS)
        commander.send(signal.SIGKILL)
        commander.wait()
    seen = record_where(client, lambda r: count(r, "reference_stale") > 0)
    assert seen.cycle.mode == torqued.Mode.HOLD
    assert_holds(client)
    # Another client may command now.
    with torqued.Commander(client) as next_one:
        next_one.send()
    report = process.terminate()
    assert report["fault"] == 0


def test_references_for_a_dead_daemon_do_not_reach_the_next(leg):
    with simulator(leg):
        with daemon(leg) as first:
            client = torqued.Client("leg", timeout_s=10.0)
            with Process(PYTHON, "rt-tests/vcan/command.py", "leg", "stubborn") as commander:
                commander.wait_for("commanding")
                record_where(client, lambda r: r.cycle.mode == torqued.Mode.INVERSE_DYNAMICS)
                first.send(signal.SIGKILL)
                first.wait()
                with daemon(leg) as second:
                    client = torqued.Client("leg", timeout_s=10.0)
                    # Its filters are full long before that.
                    record_where(client, lambda r: r.cycle.sequence > 300)
                    modes = {client.next_record(timeout_s=5.0).cycle.mode for _ in range(200)}
                    assert modes == {torqued.Mode.HOLD}
                    second.terminate()
