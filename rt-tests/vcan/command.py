"""A client that commands the robot to stay where it is, and never stops.

    python command.py ROBOT [nan | stubborn]

nan: with NaN for the first joint's wanted torque; stubborn: even where nobody listens.
"""

import math
import sys
import time

import torqued

client = torqued.Client(sys.argv[1], timeout_s=10.0)
commander = torqued.Commander(client)
wanted = commander.reference
wanted.mode = torqued.Mode.INVERSE_DYNAMICS
for joint, seen in zip(wanted.joints, client.next_record().cycle.measured.joints):
    joint.q_d = seen.q
if sys.argv[2:] == ["nan"]:
    wanted.mode = torqued.Mode.TORQUE
    wanted.joints[0].tau_d = math.nan
commander.send()
print("commanding", flush=True)
while True:
    time.sleep(0.005)
    try:
        commander.send()
    except torqued.NoDaemonError:
        if sys.argv[2:] != ["stubborn"]:
            raise
