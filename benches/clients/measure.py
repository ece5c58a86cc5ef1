"""Latency and rate of each client, beside a simulated leg at 1 kHz: the table of docs/clients.md.

    cargo build --release --workspace --bins --examples
    .venv/bin/python benches/clients/measure.py [--seconds 10] [--rounds 3] [--page]

Latency is a round trip: from the sending of a reference to the first record of a cycle that followed it. It holds one
wait for the next cycle (0.5 ms in the mean), the cycle, and the client's own polling; the loop is not involved
otherwise. What has no commander is asked for its rate alone. Each client runs by itself, one after the other, and the
whole again in each round; medians of the rounds are given, and the largest of all for the maximum.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TORQUED = ROOT / "config/leg/robot.toml"
PAGE = ROOT / "docs/clients.md"
PROGRAM = Path(__file__).resolve().relative_to(ROOT)
# The section that --page writes, and what follows it.
SECTION, NEXT = "## Measured\n", "\n## ROS 2\n"


def compiled(binaries, folder):
    """The C++ example, against the library of these binaries."""
    subprocess.run([ROOT / "client/c/install.sh", folder, binaries / "libtorqued_c.so"], check=True, stdout=sys.stderr)
    program, include, library = folder / "round_trip", folder / "include", folder / "lib"
    source = ROOT / "client/c/examples/06_round_trip.cpp"
    command = ["c++", "-O2", "-std=c++17", source, "-I", include, "-L", library, "-ltorqued", f"-Wl,-rpath,{library}"]
    subprocess.run([*command, "-o", program], check=True)
    return program


def round_trip(command, environment):
    done = subprocess.run(command, env=environment, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def lines_per_second(command, environment, seconds):
    """Records of a program that prints one in a line; the first second is left out."""
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as program:
        begin = time.monotonic() + 1.0
        sequences, end = [], begin + seconds
        for line in program.stdout:
            now = time.monotonic()
            if now > end:
                break
            if now > begin:
                sequences.append(json.loads(line)["sequence"])
        program.terminate()
    spanned = sequences[-1] - sequences[0] + 1
    return {"records_per_s": len(sequences) / seconds, "lost": spanned - len(sequences)}


def measured(binaries, program, environment, seconds):
    """One round: each client by itself."""
    python = ROOT / "client/python/examples/02_round_trip.py"
    watch = [binaries / "torquectl", "watch", "--json", "--rate", "1000"]
    return {
        "Rust": round_trip([binaries / "examples/04_round_trip", "leg", str(seconds)], environment),
        "C, C++": round_trip([program, "leg", str(seconds)], environment),
        "Python": round_trip([sys.executable, python, "leg", str(seconds)], environment),
        "`torquectl watch --json`": lines_per_second(watch, environment, seconds),
    }


def joined(rounds):
    """One result of several rounds."""
    of = {"max_ms": max, "lost": sum, "unanswered": sum}
    return {
        name: {key: of.get(key, statistics.median)([each[name][key] for each in rounds]) for key in keys}
        for name, keys in rounds[0].items()
    }


def section(found, asked):
    model = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name"))
    machine = f"{model.split(':')[1].strip()}, {os.cpu_count()} cores, Linux {platform.release()}"
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    opening = f"""`{PROGRAM} --seconds {asked.seconds:g} --rounds {asked.rounds} --page` has measured this, with programs of
`target/{asked.binaries.name}` beside a simulated leg, on {machine}; load {load}, its own included. A round trip
goes from sending a reference to the first record of a cycle that followed it. Unanswered: the lease ended."""
    text = f"""{SECTION}
{textwrap.fill(opening, 120)}

| client | records a second | lost | round trip p50, ms | p99 | max | unanswered |
| --- | ---: | ---: | ---: | ---: | ---: | ---: |
"""
    for name, of in found.items():
        trip = [f"{of[key]:.2f}" if key in of else "" for key in ("p50_ms", "p99_ms", "max_ms")]
        cells = [name, f"{of['records_per_s']:.0f}", of["lost"], *trip, of.get("unanswered", "")]
        text += f"| {' | '.join(map(str, cells))} |\n"
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each client")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--binaries", type=Path, default=ROOT / "target/release")
    parser.add_argument("--page", action="store_true", help="write the table into docs/clients.md, print nothing")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    binaries = asked.binaries.absolute()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        environment = os.environ | {
            "TORQUED_RUN_DIR": str(folder / "run"),
            "XDG_STATE_HOME": str(folder / "state"),
            "PYTHONPATH": str(ROOT / "client/python"),
        }
        program = compiled(binaries, folder)
        command = [binaries / "torqued", "run", TORQUED, "--simulate"]
        daemon = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True)
        try:
            for line in daemon.stderr:
                if "state: holding" in line:
                    break
            time.sleep(1.0)
            found = joined([measured(binaries, program, environment, asked.seconds) for _ in range(asked.rounds)])
        finally:
            daemon.terminate()
            daemon.wait()
    if asked.json:
        print(json.dumps(found))
    elif asked.page:
        text = PAGE.read_text()
        begin, end = text.find(SECTION), text.index(NEXT)
        PAGE.write_text(text[: begin if begin >= 0 else end + 1] + section(found, asked) + text[end:])
    else:
        print(section(found, asked), end="")


if __name__ == "__main__":
    main()
