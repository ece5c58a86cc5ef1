"""Times whole-body updates beside iDynTree's, in turns: bench.py BENCH_PROGRAM HUMANOID_URDF"""

import statistics
import subprocess
import sys
import time
from pathlib import Path

import icub_models
import idyntree.bindings as idyn

HERE = Path(__file__).resolve().parent
ICUB = str(icub_models.get_model_file("iCubGazeboV2_5"))
CONTACTS = ["root_link", "l_lower_leg", "r_lower_leg", "l_foot", "r_foot", "l_hand", "r_hand"]
ROUNDS = 7


class IDynTree:
    """One full wrench on every part; everything is prepared, so that only the update is timed."""

    def __init__(self):
        loader = idyn.ModelLoader()
        assert loader.loadModelFromFile(ICUB)
        self.estimator = idyn.ExtWrenchesAndJointTorquesEstimator()
        assert self.estimator.setModel(loader.model())
        model = self.estimator.model()
        self.motion = [idyn.JointPosDoubleArray(model), idyn.JointDOFsDoubleArray(model), idyn.JointDOFsDoubleArray(model)]
        for k, x in enumerate(self.motion):
            for j in range(model.getNrOfDOFs()):
                x.setVal(j, 0.1 * (k + 1) + 0.01 * j)
        self.frame = model.getFrameIndex("head_imu_0")
        self.imu = []
        for numbers in ((0.5, -0.3, 9.7), (0.1, 0.2, -0.3), (1.0, -2.0, 0.5)):
            v = idyn.Vector3()
            for i, x in enumerate(numbers):
                v.setVal(i, x)
            self.imu.append(v)
        self.readings = idyn.SensorsMeasurements(model.sensors())
        self.unknowns = idyn.LinkUnknownWrenchContacts(model)
        for link in CONTACTS:
            unknown = idyn.UnknownWrenchContact(idyn.FULL_WRENCH, idyn.Position(0, 0, 0))
            self.unknowns.addNewContactForLink(model.getLinkIndex(link), unknown)
        self.wrenches = idyn.LinkContactWrenches(model)
        self.tau = idyn.JointDOFsDoubleArray(model)

    def median_ns(self, repeats=3000):
        times = []
        for _ in range(repeats):
            start = time.perf_counter_ns()
            self.estimator.updateKinematicsFromFloatingBase(*self.motion, self.frame, *self.imu)
            self.estimator.estimateExtWrenchesAndJointTorques(self.unknowns, self.readings, self.wrenches, self.tau)
            times.append(time.perf_counter_ns() - start)
        return statistics.median(times)


def ours(program, urdf, sensors, root):
    run = subprocess.run([program, urdf, HERE / sensors, root], capture_output=True, text=True, check=True)
    return [int(x) for x in run.stdout.split()]


def main():
    program, humanoid = sys.argv[1:]
    peer = IDynTree()
    rows = {"humanoid, 4 F/T, ours": [], "iCub, 6 F/T, ours": [], "iCub, 6 F/T, iDynTree": []}
    for _ in range(ROUNDS):
        rows["humanoid, 4 F/T, ours"].append(ours(program, humanoid, "humanoid.toml", "chest_pitch_link"))
        rows["iCub, 6 F/T, ours"].append(ours(program, ICUB, "icub.toml", "root_link"))
        rows["iCub, 6 F/T, iDynTree"].append([32, peer.median_ns()])
    print(f"{'us, median (best of rounds)':<30} {'joints':>6} {'full wrench':>14} {'pure force':>14} {'weighted':>14}")
    for name, rounds in rows.items():
        cells = [f"{statistics.median(c) / 1e3:6.1f} ({min(c) / 1e3:.1f})" for c in list(zip(*rounds))[1:]]
        print(f"{name:<30} {int(rounds[0][0]):>6} " + " ".join(f"{c:>14}" for c in cells))


main()
