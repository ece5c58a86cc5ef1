"""The leg: torqued and torqued-sim as two processes on two buses, a Python client as a third."""

import math
import re
from types import SimpleNamespace

import pytest
from processes import PYTHON, Process, daemon, kernel_frames, simulator

SECONDS = 10
INTERFACES = ("vcan0", "vcan1")


@pytest.fixture(scope="module")
def run(leg):
    """The reports of both over ten seconds, and the kernel's counts of frames on the buses."""
    cycles = round(SECONDS * float(re.search(r"rate_hz = ([\d.]+)", leg.read_text())[1]))
    before = kernel_frames(*INTERFACES)
    with simulator(leg) as sim, daemon(leg) as torqued:
        with Process(PYTHON, "rt-tests/vcan/read_torques.py", "leg", cycles) as client:
            seen = client.report()
        report = torqued.terminate()
        robot = sim.terminate()
    return SimpleNamespace(
        cycles=cycles,
        torqued=report,
        sim=robot,
        client=seen,
        kernel=kernel_frames(*INTERFACES) - before,
    )


def test_every_cycle_was_answered(run):
    # Some answers may be late: this kernel gives no guarantee of time.
    assert run.torqued["cycles"] == run.sim["cycles"] >= run.cycles
    assert run.torqued["fault"] == 0


def test_not_one_frame_is_lost(run):
    assert run.torqued["frames_received"] == run.sim["frames_sent"]
    assert run.sim["frames_received"] == run.torqued["frames_sent"]
    assert run.kernel == run.torqued["frames_sent"] + run.sim["frames_sent"]
    # 2 SYNC frames a cycle, and 2 command frames while drives are on; 6 joint states and 2 F/T
    # frames in answer.
    assert 2 * run.torqued["cycles"] < run.torqued["frames_sent"] < 4 * run.torqued["cycles"]
    assert run.torqued["frames_received"] == 8 * run.torqued["cycles"]


def test_not_one_frame_is_undecoded(run):
    for event in ("frame_unknown_id", "frame_wrong_length", "receive_overflow", "send_failed"):
        assert event not in run.torqued["events"]
    assert run.sim["frames_unknown"] == run.sim["frames_undecoded"] == run.sim["frames_lost"] == 0


def test_python_client_reads_every_joints_torque(run):
    records = run.client["records"]
    assert records > 0
    assert len(run.client["joints"]) == 6
    for name, joint in run.client["joints"].items():
        for source, seen in joint.items():
            assert seen["valid"] == records, (name, source)
            assert math.isfinite(seen["sum"]), (name, source)
