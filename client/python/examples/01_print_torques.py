"""Prints every joint's torque ten times a second, until the daemon ends.

    python 01_print_torques.py leg [SECONDS]
"""

import sys
import time

import torqued

PERIOD_S = 0.1


def main() -> None:
    robot = sys.argv[1] if len(sys.argv) > 1 else "leg"
    end = time.monotonic() + (float(sys.argv[2]) if len(sys.argv) > 2 else float("inf"))
    client = torqued.Client(robot)
    next_print = time.monotonic()
    for record in client.records():
        now = time.monotonic()
        if now > end:
            return
        if now < next_print:
            continue
        next_print = now + PERIOD_S
        print(f"cycle {record.cycle.sequence} ({client.lost} records lost)")
        for name, joint in zip(client.joint_names, record.cycle.estimated.joints):
            encoder, whole_body = joint.tau_encoder, joint.tau_whole_body
            print(
                f"  {name:24} encoder {encoder.tau:8.2f} ± {encoder.sigma:5.2f} N·m,"
                f" whole-body {whole_body.tau:8.2f} ± {whole_body.sigma:5.2f} N·m",
                flush=True,
            )


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
    except (torqued.NoDaemonError, torqued.OtherLayoutError, torqued.RunDirectoryError) as e:
        sys.exit(str(e))
