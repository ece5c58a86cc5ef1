#!/usr/bin/env python3
"""Hours in the life of a daemon, in minutes: writes docs/results/operation.md.

    cargo build --release -p torqued -p torquectl -p torqued-client --examples --bins
    benches/operation/measure.py [--minutes 30] [--clients 1000] [--daemons 100]

Needs Debian's stress-ng and rt-tests, and the right to real-time priorities. Three parts, on the simulated leg:
soak   the daemon records under stress-ng (CPU, memory, disk) while seven clients come and go, half of them killed
kills  clients and daemons killed by SIGKILL: what is left, how soon the robot holds without its commander
wake   wake-up of the daemon's loop beside cyclictest on the same core in the same run, idle and under stress-ng
What is not said to be otherwise is measured with whatever else the machine does.
"""

import argparse
import json
import os
import platform
import random
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from datetime import date
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/results/operation.md"
SHM = Path("/dev/shm")
STRESS = ["stress-ng", "--cpu", "2", "--vm", "1", "--vm-bytes", "512M", "--hdd", "1", "--hdd-bytes", "256M"]
BUILDS = {
    "release": "release builds",
    "debug": "builds of the profile dev, in which only the loop's crates are optimised",
}
# Time after which memory counts: all that is made at the start is there.
WARM_S = 60.0
# A client's life, s.
LIFE_S = (0.5, 10.0)
ENDED = (0, -signal.SIGTERM, -signal.SIGKILL)


class Bench:
    """A folder for everything, programs, and what is found."""

    def __init__(self, folder, binaries):
        self.folder, self.binaries, self.started = folder, binaries, []
        for part in ("config", "robot-models"):
            shutil.copytree(ROOT / part, folder / part)
        self.config = folder / "config/leg/robot.toml"
        places = {"TORQUED_RUN_DIR": "run", "XDG_STATE_HOME": "state"}
        self.environment = os.environ | {name: str(folder / place) for name, place in places.items()}

    def start(self, *command, **options):
        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "text": True} | options
        command = [str(part) for part in command]
        process = subprocess.Popen(command, cwd=self.folder, env=self.environment, **options)
        self.started = [other for other in self.started if other.poll() is None] + [process]
        return process

    def end_all(self):
        """Also where a part has failed: a daemon that is left over runs with real-time priority."""
        for process in self.started:
            process.kill()

    def daemon(self, *options):
        """A daemon that runs, and its first seconds are over."""
        log = (self.folder / "daemon.log").open("w")
        command = [self.binaries / "torqued", "run", self.config, "--simulate", "--json", *options]
        daemon = self.start(*command, stdout=subprocess.PIPE, stderr=log)
        until = time.monotonic() + 30
        while "state: holding" not in (self.folder / "daemon.log").read_text():
            if daemon.poll() is not None or time.monotonic() > until:
                sys.exit(f"the daemon does not start:\n{(self.folder / 'daemon.log').read_text()}")
            time.sleep(0.05)
        return daemon

    def ctl(self, *command):
        command = [self.binaries / "torquectl", *command]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"{' '.join(map(str, command))}: {done.stderr}")
        return done.stdout

    def stress(self, seconds):
        return self.start(*STRESS, "--temp-path", self.folder, "--timeout", f"{seconds:.0f}s")

    def client(self):
        return self.start(self.binaries / "examples/01_print_torques", "leg", stdout=subprocess.PIPE)

    def commander(self):
        return self.start(self.binaries / "examples/04_round_trip", "leg", "600")


def end(process):
    """The daemon's own report."""
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=30)
    return json.loads(out.splitlines()[-1])


def memory(pid):
    """Resident memory by kind, MB."""
    kinds = {"RssAnon": "own", "RssShmem": "shared", "RssFile": "files"}
    lines = (line.split() for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    return {kinds[key[:-1]]: int(rest[0]) / 1024 for key, *rest in lines if key[:-1] in kinds}


def slope(points):
    """Growth of (hours, MB), MB/h."""
    x, y = zip(*points, strict=True)
    return statistics.linear_regression(x, y).slope


def come_and_go(bench, stop, found):
    """One place of a client: it lives for some seconds, then ends or is killed, then the next one comes."""
    while not stop.is_set():
        client = bench.client()
        stop.wait(random.uniform(*LIFE_S))
        killed = random.random() < 0.5
        client.send_signal(signal.SIGKILL if killed else signal.SIGTERM)
        out, _ = client.communicate()
        lines = [line for line in out.splitlines() if line.startswith("cycle ") and line.endswith("records lost)")]
        found["clients"] += 1
        found["killed"] += killed
        if client.returncode not in ENDED:
            found["failed"] += 1
        if len(lines) > 1:
            first, last = (int(line.split()[1]) for line in (lines[0], lines[-1]))
            found["records"] += last - first
            found["lost"] += int(lines[-1].split("(")[1].split()[0])


def soak(bench, seconds, places=7):
    before = set(os.listdir(SHM))
    daemon = bench.daemon()
    recording = bench.folder / "soak.mcap"
    command = [bench.binaries / "torquectl", "record", "-o", recording, "--content", "frames"]
    recorder = bench.start(*command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    stress = bench.stress(seconds)
    stop, found = threading.Event(), dict.fromkeys(("clients", "killed", "failed", "records", "lost"), 0)
    threads = [threading.Thread(target=come_and_go, args=(bench, stop, found)) for _ in range(places)]
    for thread in threads:
        thread.start()
    begin, points = time.monotonic(), []
    while (now := time.monotonic() - begin) < seconds:
        if daemon.poll() is not None:
            sys.exit(f"the daemon ended: {(bench.folder / 'daemon.log').read_text()}")
        points.append((now, memory(daemon.pid)))
        time.sleep(1.0)
    stop.set()
    for thread in threads:
        thread.join()
    stress.terminate()
    stress.wait()
    recorder.send_signal(signal.SIGINT)
    recorded, _ = recorder.communicate()
    time.sleep(2.0)
    times = json.loads(bench.ctl("timing", "--json"))
    report = end(daemon)
    lost = re.search(r"(\d+) cycles, (\d+) lost", recorded)
    if lost is None:
        sys.exit(f"no recording: {recorded}")
    return {
        "seconds": seconds,
        "memory": points,
        "clients": found,
        "times": times,
        "report": report,
        "recording": {"cycles": int(lost[1]), "lost": int(lost[2]), "MB": recording.stat().st_size / 1e6},
        "left": sorted(set(os.listdir(SHM)) - before),
    }


def hold_after(bench, watch):
    """Time from the kill of a commander to the first record without one, s."""
    commander = bench.commander()
    until = time.monotonic() + 10
    while json.loads(watch.stdout.readline())["commander"] is None:
        if time.monotonic() > until:
            sys.exit("the robot has no commander after 10 s")
    commander.kill()
    killed = time.monotonic()
    while json.loads(watch.stdout.readline())["commander"] is not None:
        pass
    took = time.monotonic() - killed
    commander.wait()
    return took


def kills(bench, clients, daemons):
    before = set(os.listdir(SHM))
    daemon = bench.daemon()
    command = [bench.binaries / "torquectl", "watch", "--json", "--rate", "200"]
    watch = bench.start(*command, stdout=subprocess.PIPE, stderr=None)
    points, holds, killed = [], [], 0
    while killed < clients:
        crowd = [bench.client() for _ in range(min(6, clients - killed))]
        holds.append(hold_after(bench, watch))
        killed += 1 + len(crowd)
        for client in crowd:
            client.kill()
        for client in crowd:
            client.communicate()
        points.append((killed, memory(daemon.pid), len(set(os.listdir(SHM)) - before)))
    watch.kill()
    watch.communicate()
    time.sleep(2.0)
    after = memory(daemon.pid)
    end(daemon)
    left_by_clients = sorted(set(os.listdir(SHM)) - before)
    for _ in range(daemons):
        daemon = bench.daemon()
        crowd = [bench.client() for _ in range(2)]
        time.sleep(0.2)
        daemon.kill()
        daemon.communicate()
        for client in crowd:
            client.kill()
            client.communicate()
    end(bench.daemon())
    return {
        "clients": killed,
        "daemons": daemons,
        "holds": holds,
        "points": points,
        "after": after,
        "left_by_clients": left_by_clients,
        "left": sorted(set(os.listdir(SHM)) - before),
    }


def quantiles(histogram):
    """p50, p99 and the largest of {us: count}."""
    total, at, found = sum(histogram.values()), 0, []
    wanted = [0.5, 0.99, 1.0]
    for us, count in sorted(histogram.items()):
        at += count
        while wanted and at >= wanted[0] * total:
            found.append(us)
            wanted.pop(0)
    return found


def wake(bench, seconds, core, stressed):
    """Both threads on one core, cyclictest above the loop, whose wake-up it delays by itself at most."""
    text = bench.config.read_text()
    pinned = text.replace("priority = 80", f"priority = 80\ncpu = {core}")
    if pinned == text:
        sys.exit(f"{bench.config}: no key `priority = 80` to pin the loop beside")
    bench.config.write_text(pinned)
    stress = bench.stress(seconds + 10) if stressed else None
    daemon = bench.daemon()
    histogram = bench.folder / "cyclictest"
    command = ["cyclictest", "-m", "-q", "-p", "81", "-i", "1000", "-t", "1", "-a", str(core), "-D", f"{seconds:.0f}"]
    subprocess.run([*command, "-h", "20000", f"--histfile={histogram}"], check=True, stdout=subprocess.DEVNULL)
    own = end(daemon)["wake_late_ns"]
    if stress:
        stress.terminate()
        stress.wait()
    bench.config.write_text(text)
    of_cyclictest, most = {}, 0
    for line in histogram.read_text().splitlines():
        if line.startswith("# Max Latencies:"):
            most = int(line.split()[-1])
        elif line and not line.startswith("#"):
            us, count = line.split()[:2]
            of_cyclictest[int(us)] = int(count)
    p50, p99, _ = quantiles(of_cyclictest)
    loop = [1e-3 * own[key] for key in ("p50", "p99", "max")]
    return {"stressed": stressed, "cyclictest": [p50, p99, most], "loop": loop}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", default="soak,kills,wake", help="those to run; the page needs all")
    parser.add_argument("--minutes", type=float, default=10.0, help="of the soak")
    parser.add_argument("--clients", type=int, default=200, help="that are killed")
    parser.add_argument("--daemons", type=int, default=20, help="that are killed")
    parser.add_argument("--wake-seconds", type=float, default=60.0, help="of each comparison with cyclictest")
    parser.add_argument("--core", type=int, default=(os.cpu_count() or 1) - 1, help="of that comparison")
    parser.add_argument("--binaries", type=Path, default=ROOT / "target/release")
    parser.add_argument("--json", action="store_true", help="print what was measured; write no page")
    asked = parser.parse_args()
    options = f"--minutes {asked.minutes:g} --clients {asked.clients} --daemons {asked.daemons}"
    build = BUILDS.get(asked.binaries.name, "builds of " + asked.binaries.name)
    found = {"machine": machine(), "asked": options, "build": build}
    # On a disk: /tmp may be memory.
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        bench = Bench(Path(folder), asked.binaries.absolute())
        parts = {
            "soak": lambda: soak(bench, 60.0 * asked.minutes),
            "kills": lambda: kills(bench, asked.clients, asked.daemons),
            "wake": lambda: [wake(bench, asked.wake_seconds, asked.core, stressed) for stressed in (False, True)],
        }
        try:
            for part in asked.parts.split(","):
                if part not in parts:
                    parser.error(f"--parts: no part {part!r}; allowed: {', '.join(parts)}")
                print(f"{part} ...", file=sys.stderr)
                found[part] = parts[part]()
        finally:
            bench.end_all()
    if asked.json:
        print(json.dumps(found))
    else:
        # Beside this program.
        from page import page

        PAGE.write_text(page(found))
        print(PAGE)


def machine():
    model = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name"))
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    name, kernel = model.split(":")[1].strip(), platform.release()
    return f"{name}, {os.cpu_count()} cores, Linux {kernel}, load before {load}, {date.today():%d %B %Y}"


if __name__ == "__main__":
    main()
