"""Measures how soon a reference is seen in a record: from its sending to the first record of a cycle that followed it.

    python 02_round_trip.py leg [SECONDS]

The robot only holds. Prints one line of JSON.
"""

import json
import sys
import time

import torqued

# A reference that no cycle has followed by then came after its lease had ended: this program was kept from running.
UNANSWERED_S = 0.1


def main() -> None:
    robot = sys.argv[1] if len(sys.argv) > 1 else "leg"
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    client = torqued.Client(robot)
    commander = torqued.Commander(client)
    client.latest()
    lost_before, begin = client.lost, time.monotonic()
    trips, records, unanswered = [], 0, 0
    while time.monotonic() - begin < seconds:
        sent = time.perf_counter()
        commander.send()
        while True:
            record = client.next_record()
            records += 1
            took = time.perf_counter() - sent
            if record.cycle.commander.sequence >= commander.reference.sequence:
                trips.append(1e3 * took)
                break
            if took > UNANSWERED_S:
                unanswered += 1
                break
    took = time.monotonic() - begin
    commander.close()
    trips.sort()

    def at(share: float) -> float:
        return round(trips[int((len(trips) - 1) * share)], 3)

    found = {"records_per_s": round(records / took, 1), "lost": client.lost - lost_before, "unanswered": unanswered}
    print(json.dumps(found | {"p50_ms": at(0.5), "p99_ms": at(0.99), "max_ms": at(1.0)}))


if __name__ == "__main__":
    main()
