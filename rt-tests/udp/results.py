"""Figures of the tests in this folder, as docs/results/drives.md shows them."""

import csv
import platform
import time
from pathlib import Path

#: Rows by table, in the order of the tests.
TABLES = {"stops": [], "set-up": []}
COMMAND = "TORQUED_RESULTS=docs/results/drives.md rt-tests/udp/run.sh -k 'killed or pulled or planned or lost_frame'"


def stop_ms(act, drives, limit_s=2.0):
    """Time from the act until no drive is enabled, ms."""
    assert all(drive.enabled for drive in drives), "off before: the machine stalled for longer than their time-outs"
    act()
    begin = time.monotonic()
    while any(drive.enabled for drive in drives):
        assert time.monotonic() < begin + limit_s, "it goes on"
        time.sleep(0.002)
    return 1000 * (time.monotonic() - begin)


def write(path):
    """Writes the page if every table has rows."""
    assert all(TABLES.values()), "run all that the page shows"
    stops = {}
    for family, limit_ms, act, ms in TABLES["stops"]:
        stops.setdefault((family, limit_ms), {})[act] = f"{ms:.0f}"
    lines = [
        "# Drives: what happens when something breaks",
        "",
        "```sh",
        COMMAND,
        "```",
        "",
        "runs `torqued run` on a UDP bus at 200 Hz against [drives of other people's](../drives.md) and the actuators of"
        " `rt-tests/udp/actuators.py`, and writes this page.",
        "",
        f"{time.strftime('%d %B %Y')}, {platform.machine()}, two processors.",
        "",
        "## Time until every drive is off",
        "",
        "From the event, with two drives that hold, ms. `limit`: the drive's own time without a heartbeat or a command.",
        "",
        "| family | limit | `kill -9` of the daemon | bus pulled |",
        "| --- | --- | --- | --- |",
    ]
    for (family, limit_ms), times in stops.items():
        lines.append(f"| {family} | {limit_ms} | {times.get('killed', '-')} | {times.get('pulled', '-')} |")
    lines += [
        "",
        "## Set-up interrupted",
        "",
        "Nothing has moved in any of them. Where the daemon ends, it does so with exit code 1, and the drive is off.",
        "",
        f"[{len(TABLES['set-up'])} interruptions](drives-set-up.csv), and what is said of each.",
    ]
    with open(Path(path).with_name("drives-set-up.csv"), "w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("interrupted by", "what is said"))
        rows.writerows(TABLES["set-up"])
    Path(path).write_text("\n".join(lines) + "\n")
