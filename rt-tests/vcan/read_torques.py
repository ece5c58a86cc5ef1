"""A client that reads records until the robot has run so many cycles, and reports their torques.

    python read_torques.py ROBOT CYCLES
"""

import json
import sys

import torqued

robot, cycles = sys.argv[1], int(sys.argv[2])
client = torqued.Client(robot, timeout_s=10.0)
joints = {
    name: {source: {"valid": 0, "sum": 0.0} for source in ("tau_encoder", "tau_whole_body")}
    for name in client.joint_names
}
records = 0
for record in client.records(timeout_s=10.0):
    records += 1
    for name, joint in zip(joints, record.cycle.estimated.joints):
        for source, seen in joints[name].items():
            estimate = getattr(joint, source)
            seen["valid"] += bool(estimate.flags & torqued.TorqueFlags.VALID)
            seen["sum"] += estimate.tau
    if record.timing.cycles >= cycles:
        break
print(json.dumps({"records": records, "lost": client.lost, "joints": joints}))
