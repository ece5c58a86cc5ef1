"""The page docs/results/operation.md of what measure.py has found."""

import textwrap

from measure import WARM_S, slope

HEAD = """# A daemon at work

`benches/operation/measure.py {asked}` has written this page, with the simulated leg at 1 kHz. The programs
were {build}; the machine: {machine}.

"""


def page(found):
    parts = {"soak": soak, "kills": kills, "wake": wake}
    texts = [parts[name](found[name]) for name in parts if name in found]
    blocks = (HEAD.format(**found) + "\n".join(texts)).strip().split("\n\n")
    return "\n\n".join(block if block[0] in "#|" else textwrap.fill(block, 120) for block in blocks) + "\n"


def table(head, rows):
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)


def soak(found):
    points, clients, times = found["memory"], found["clients"], found["times"]
    recording = found["recording"]
    at = [min(points, key=lambda point: abs(point[0] - t)) for t in (0, WARM_S, points[-1][0] / 2, points[-1][0])]
    rows = [[f"{t:.0f}", *(f"{kinds[kind]:.1f}" for kind in ("own", "shared", "files"))] for t, kinds in at]
    warm = [(t / 3600, kinds["own"]) for t, kinds in points if t > WARM_S]
    text = f"""## Soak: {found["seconds"] / 60:.0f} minutes under load

`stress-ng` loads CPU, memory and disk, and the daemon records. Seven clients live for up to ten seconds each;
SIGKILL ends half of them.

The daemon's resident memory, MB; files are mapped ones:

"""
    text += table(["after, s", "own", "shared", "files"], rows)
    growth = slope(warm)
    report, seen = found["report"], clients["records"] + clients["lost"]
    late = times["late_cycles"]
    causes = sorted(times["late_by_cause"].items(), key=lambda cause: -cause[1])
    attributed = sum(count for _, count in causes)
    text += f"""
After the first minute its own memory grows by {growth:.2f} MB an hour (a line through {len(warm)} points).

Of {clients["clients"]} clients {clients["killed"]} were killed, {clients["failed"]} ended by an error. They
read {clients["records"]} records and lost {clients["lost"]} ({1e6 * clients["lost"] / max(seen, 1):.0f} of a million).
The recording of {recording["MB"]:.0f} MB holds {recording["cycles"]} cycles, {recording["lost"]} were lost.

Of {report["cycles"]} cycles {report["late_cycles"]} ended late: a simulated robot waits for a loop that misses a start.
The publisher came too late for {report["records_dropped"]} records. Two seconds before the end {late} were late, {attributed}
with a known cause:

"""
    text += table(["cause", "late cycles"], causes or [["none", 0]])
    return text + f"\nLeft in `/dev/shm`: {left(found['left'])}.\n"


def left(names):
    """Objects by what they are for. iceoryx2 keeps a counter for each run directory."""
    kept = [name for name in names if name.endswith(".global_mgmt")]
    others = sorted({name.rsplit(".", 1)[-1] for name in names if name not in kept})
    count = len(names) - len(kept)
    text = f"{count} objects ({', '.join(others)})" if count else "nothing"
    return text + (" but iceoryx2's counter (16 bytes)" if kept else "")


def kills(found):
    holds = sorted(1e3 * x for x in found["holds"])
    points = found["points"]
    step = max(1, len(points) // 4)
    rows = [[killed, f"{kinds['own']:.1f}", f"{kinds['shared']:.1f}", objects] for killed, kinds, objects in points]
    text = f"""## Kills: {found["clients"]} clients and {found["daemons"]} daemons by SIGKILL

Six readers and a commander are killed at a time; the eighth client that a robot takes watches.

"""
    chosen = rows[::step] + ([rows[-1]] if (len(rows) - 1) % step else [])
    text += table(["clients killed", "daemon's own memory, MB", "shared, MB", "objects in /dev/shm"], chosen)
    middle = holds[len(holds) // 2]
    return text + f"""
Two seconds after the last kill its own memory is {found["after"]["own"]:.1f} MB. After the kill of its commander the
robot held within {middle:.0f} ms (median of {len(holds)}), {holds[-1]:.0f} ms at most, up to 5 ms of it the watching
program's. Left by the clients, once the daemon has ended: {left(found["left_by_clients"])}. Left by killed daemons, each
with two clients, once a last one has ended: {left(found["left"])}.
"""


def wake(found):
    text = """## Wake-up beside cyclictest

`cyclictest` (1 kHz, priority 81) and the loop (priority 80) on one core in the same minute, us after the timer's
instant; the loop's run is some seconds longer.

"""
    rows = []
    for of in found:
        state = "under stress-ng" if of["stressed"] else "no load of ours"
        for name in ("cyclictest", "loop"):
            rows.append([f"{name}, {state}", *(f"{x:.0f}" for x in of[name])])
        ratios = (own / other if other else float("inf") for own, other in zip(of["loop"], of["cyclictest"], strict=True))
        rows.append([f"loop / cyclictest, {state}", *(f"{x:.2f}" for x in ratios)])
    return text + table(["", "p50", "p99", "max"], rows)
