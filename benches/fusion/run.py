#!/usr/bin/env python3
"""Judges the fused torque of the simulated robots beside that from encoders alone, and the sigmas of all.

    cargo build --release -p torqued
    python3 benches/fusion/run.py --out docs/results/fusion.md

Runs `torqued demo`, which compares every cycle's torques with the true ones, for each robot with and without its
calibration and for several seeds: other sensors, offsets, pasts of the gears, and masses. Needs Python alone.
"""

import argparse
import concurrent.futures
import csv
import json
import math
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Robots, and whether their calibration counts. hrp2-like has no link-side encoders: its sigmas alone are judged.
ROBOTS = [("humanoid", True), ("leg", True), ("test-joint", True), ("lift-gripper", True), ("hrp2-like", True),
          ("humanoid", False), ("leg", False), ("test-joint", False), ("lift-gripper", False),
          ("hrp2-like", False)]  # fmt: skip
#: Geometric mean and worst of the fused over the encoders' error, range of error over sigma, and its share of joints.
AIM = 0.92, 1.15, (0.5, 2.0), 0.95
SOURCES = "encoder", "whole_body", "delay_compensated"
LISTED = 5


def run(program, robot, calibrated, seed, seconds):
    """Joints of one demo: errors of the torque from encoders, from F/T sensors, and of both."""
    command = [program, "demo", "--robot", robot, "--fast", "--json", "--seconds", str(seconds), "--seed", str(seed)]
    command += [] if calibrated else ["--uncalibrated"]
    # Of the humanoid, whose demo balances, the motion is one whose loads do not depend on that.
    command += ["--motion", "config/humanoid/bow.toml"] if robot == "humanoid" else []
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if not done.stdout:
        sys.exit(f"{' '.join(command)}: {done.stderr.strip()}")
    report = json.loads(done.stdout)
    if report["fault"]:
        sys.exit(f"{' '.join(command)}: fault {report['fault']}")
    return [dict(joint, seed=seed) for joint in report["joints"]]


def mean(values):
    """Geometric mean; nothing of nothing."""
    return math.exp(statistics.fmean(map(math.log, values))) if values else math.nan


def ratio(joint):
    """Error of the fused torque over that from encoders; none where either is missing."""
    encoder, fused = joint["encoder"], joint["delay_compensated"]
    return fused["rms"] / encoder["rms"] if encoder and fused and encoder["rms"] > 0 else None


def rows(name, joints):
    """One row for each joint, over all seeds: name, errors, ratio's geometric mean and worst, error over sigma."""
    for joint in dict.fromkeys(j["name"] for j in joints):
        own = [j for j in joints if j["name"] == joint]
        ratios = [r for r in map(ratio, own) if r is not None]
        figures = []
        for source in SOURCES:
            errors = [j[source] for j in own if j[source]]
            figures.append((mean([e["rms"] for e in errors]), [e["rms_of_sigma"] for e in errors]))
        cells = [f"{rms:.4f}" for rms, _ in figures]
        cells += [f"{mean(ratios):.3f}", f"{max(ratios, default=math.nan):.3f}"]
        cells += [f"{f(values):.2f}" if values else "nan" for _, values in figures for f in (min, max)]
        yield [name, joint, *cells]


HEADS = ["robot", "joint", "encoders", "F/T sensors", "fused", "fused over encoders", "worst",
         *(f"{end} of {name} over sigma" for name in ("encoders", "F/T sensors", "fused")
           for end in ("least", "most"))]  # fmt: skip
PAGE = """# The fused torque

Written by `python3 benches/fusion/run.py --out docs/results/fusion.md`. Simulated robots in the motion of `torqued demo` (the humanoid in `config/humanoid/bow.toml`), {seconds} s, seeds {seeds}: sensors, offsets, cross-talk, masses and pasts of the gears. The calibrations are the shipped ones, of seed 1. Errors are root mean squares against the true torque of the same instant, from F/T sensors against that of their delay ago.

## Fused over encoders

| robot | joints × seeds | geometric mean (aim {mean}) | worst (aim {worst}) | which | above 1 |
| --- | --- | --- | --- | --- | --- |
{ratios}
Greatest "worst" of {rows} rows, [all](fusion-joints.csv), errors in N·m or N:

| robot | joint | encoders | F/T sensors | fused | fused over encoders | worst |
| --- | --- | --- | --- | --- | --- | --- |
{greatest}
## Error over sigma

Root mean square of error over published sigma: median, largest, and share of joints within {low} to {high} (aim {share:.0%}).

| robot | encoders | F/T sensors and model | fused |
| --- | --- | --- | --- |
{sigmas}"""


def ratio_row(name, joints):
    pairs = [(r, j) for j in joints if (r := ratio(j)) is not None]
    if not pairs:
        return f"| {name} | 0 | - | - | - | - |\n"
    worst, joint = max(pairs, key=lambda pair: pair[0])
    ratios = [r for r, _ in pairs]
    above = sum(r > 1 for r in ratios) / len(ratios)
    who = f"{joint['name']}, seed {joint['seed']}"
    return f"| {name} | {len(ratios)} | {mean(ratios):.3f} | {worst:.2f} | {who} | {above:.0%} |\n"


def sigma_row(name, joints):
    low, high = AIM[2]
    cells = []
    for source in SOURCES:
        of = [j[source]["rms_of_sigma"] for j in joints if j[source]]
        within = sum(low <= x <= high for x in of)
        cells.append(f"{statistics.median(of):.2f}, {max(of):.1f}, {within / len(of):.0%}" if of else "-")
    return f"| {name} | {' | '.join(cells)} |\n"


def page(results, seeds, seconds):
    aim, worst, (low, high), share = AIM
    table = [row for name, joints in results for row in rows(name, joints)]
    greatest = sorted((row for row in table if row[6] != "nan"), key=lambda row: -float(row[6]))[:LISTED]
    text = PAGE.format(
        seconds=seconds, seeds=seeds, mean=aim, worst=worst, low=low, high=high, share=share, rows=len(table),
        ratios="".join(ratio_row(*result) for result in results),
        greatest="".join(f"| {' | '.join(row[:7])} |\n" for row in greatest),
        sigmas="".join(sigma_row(*result) for result in results),
    )  # fmt: skip
    return text, table


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--program", default="target/release/torqued", help="torqued")
    parser.add_argument("--seeds", type=int, default=10, help="seeds from 1 on")
    parser.add_argument("--seconds", type=float, default=10, help="of each run")
    parser.add_argument("--robot", action="append", help="only this one; may be repeated")
    parser.add_argument("--calibrated", action="store_true", help="only with the calibrations")
    parser.add_argument("--jobs", type=int, default=2, help="runs side by side")
    parser.add_argument("--out", type=Path, help="the page, beside it fusion-joints.csv; without it it is printed")
    arguments = parser.parse_args()
    results = []
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for robot, calibrated in ROBOTS:
            if arguments.robot and robot not in arguments.robot or arguments.calibrated and not calibrated:
                continue
            name = f"{robot}, {'calibrated' if calibrated else 'data sheets'}"
            runs = [pool.submit(run, arguments.program, robot, calibrated, seed, arguments.seconds)
                    for seed in range(1, arguments.seeds + 1)]  # fmt: skip
            results.append((name, [joint for one in runs for joint in one.result()]))
    text, table = page(results, f"1 to {arguments.seeds}", f"{arguments.seconds:g}")
    if not arguments.out:
        print(text)
        return
    arguments.out.write_text(text)
    with (arguments.out.parent / "fusion-joints.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADS, *table])


if __name__ == "__main__":
    main()
