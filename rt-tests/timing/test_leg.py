"""The leg on a real-time machine (docs/testing.md): no cycle is late, and the loop makes no system
call but those for the timer and the bus."""

import json
import re
import subprocess

import pytest
from processes import BINARIES, ROOT, derived_config

CYCLES = 5000
# Linux on x86-64: system calls that the loop may make, by number.
TIMER = {230: "clock_nanosleep"}
BUS = {7: "poll", 271: "ppoll", 299: "recvmmsg", 307: "sendmmsg"}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder that pair.sh has filled."""
    folder = tmp_path_factory.mktemp("leg")
    config = derived_config(folder, {'real_time = "try"': 'real_time = "require"'})
    memory = [BINARIES / "torqued", BINARIES / "torqued-sim", ROOT / "robot-models", ROOT / "config"]
    preload = [option for path in memory for option in ("--preload", path)]
    # Of the host's time, of which it has only what other tests leave.
    command = ["rt-tests/vm/vcan.sh", "--real-time", "--time-limit", "1800", "--results", folder]
    command += [*preload, "--", "rt-tests/timing/pair.sh", BINARIES, config]
    run = subprocess.run(
        [str(part) for part in command],
        cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout
    return folder


@pytest.fixture(scope="module")
def torqued(results):
    """The report of torqued of the undisturbed run."""
    return json.loads((results / "torqued.json").read_text())


def counted(results, event):
    """Counts of the kernel in the second run: {key: hits}."""
    text = (results / "counts" / event).read_text()
    assert "Totals:" in text
    return {int(k): int(n) for k, n in re.findall(r"\{ \w+: +(\d+) \} hitcount: +(\d+)", text)}


def of_the_loop(results, event):
    """Counts of the kernel for the loop's thread."""
    return counted(results, event).get(int((results / "counts" / "loop_thread").read_text()), 0)


def test_every_cycle_is_on_time(torqued, capsys):
    with capsys.disabled():
        times = {key: torqued[key] for key in ("wake_late_ns", "compute_ns")}
        print(f"\n{torqued['cycles']} cycles, {torqued['late_cycles']} late: {times}")
    assert torqued["cycles"] == CYCLES
    assert torqued["late_cycles"] == 0
    assert torqued["skipped_cycles"] == 0


def test_nothing_happened(torqued):
    """No joint missed, no frame unknown or refused, no fault."""
    assert torqued["events"] == {}
    assert torqued["fault"] == 0


def test_no_frame_is_lost(torqued, results):
    sim = json.loads((results / "sim.json").read_text())
    assert torqued["frames_received"] == sim["frames_sent"] == 8 * CYCLES
    assert torqued["frames_sent"] == sim["frames_received"]
    # 2 SYNC frames in every cycle; 2 frames of set-points while the robot is enabled, which it is
    # but for its start and its end; control words where drives change their state, and seldom else.
    assert 3.8 * CYCLES < torqued["frames_sent"] < 4.1 * CYCLES


def test_loop_calls_only_timer_and_bus(results):
    calls = counted(results, "sys_enter")
    cycles = sum(calls.get(number, 0) for number in TIMER)
    assert cycles > 1900, f"the kernel was counting for {cycles} cycles only: {calls}"
    strangers = {number: n for number, n in calls.items() if number not in TIMER | BUS}
    assert not strangers, f"system calls by number: {strangers}"
    # SYNC and commands; a frame of each of two buses in two batches, at most one by one.
    assert calls[307] <= 2 * cycles + 2


@pytest.mark.parametrize(
    "function", ["malloc", "calloc", "realloc", "free", "posix_memalign", "aligned_alloc"]
)
def test_loop_does_not_allocate(results, function):
    assert of_the_loop(results, function) == 0


def test_loop_takes_no_lock(results):
    assert of_the_loop(results, "pthread_mutex_lock") == 0
    assert 202 not in counted(results, "sys_enter"), "futex: waited for a lock"


def test_loop_faults_no_page(results):
    assert of_the_loop(results, "page_fault_user") == 0


def test_other_threads_were_counted(results):
    """Otherwise the zeros above would prove nothing."""
    for event in ("malloc", "free", "page_fault_user"):
        assert sum(counted(results, event).values()) > 0, event
