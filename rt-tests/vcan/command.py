"""A client that commands the robot to stay where it is, and never stops.

    python command.py ROBOT [nan | stubborn]

nan: the first joint's desired torque is NaN; stubborn: it goes on without a daemon. Both go on where
they are not followed.
"""

import math
import sys
import time

import torqued

client = torqued.Client(sys.argv[1], timeout_s=10.0)
commander = torqued.Commander(client)
commander.hold_until_ready(10.0)
desired = commander.reference
desired.mode = torqued.Mode.INVERSE_DYNAMICS
if sys.argv[2:] == ["nan"]:
    desired.mode = torqued.Mode.TORQUE
    desired.joints[0].tau_d = math.nan
commander.send()
print("commanding", flush=True)
while True:
    time.sleep(0.005)
    try:
        commander.send()
    except (torqued.NoDaemonError, torqued.CommandLostError, torqued.NotFollowedError):
        if sys.argv[2:] == []:
            raise
