#!/bin/bash
# Calibrates the shipped robots, or those named: config/calibrate.sh [ROBOT...]
#
# The simulated robots of config/ROBOT/sim.toml are recorded by the daemon's own loop in the motions of
# config/ROBOT/calibration, and calibrated from these recordings by the commands of docs/bring-up.md. The results are
# config/ROBOT/calibrated.toml, which is robot.toml with the keys that a commit sets, and the folder that it names in
# config/ROBOT/calibrations. What was there before is replaced once a robot is done. Five minutes of a core; the programs
# are those of target/release, or of the folder PROGRAMS.
set -eu
cd "$(dirname "$0")/.."
programs=$(realpath "${PROGRAMS:-target/release}")
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT

# record NAME MOTION SECONDS [options of torqued demo]
record() {
    local name=$1 motion=$2 seconds=$3
    shift 3
    "$programs/torqued" demo --robot "config/$robot/calibrated.toml" --motion "config/$motion" --seconds "$seconds" \
        --fast --record "$name.mcap" --json "$@" >"$name.json"
}

# calibrate RECORDING... [options of torquectl calibrate]
calibrate() {
    # Exit code 1 says that something could not be calibrated, which is printed.
    "$programs/torquectl" calibrate "$@" -o calibrated || [ $? -eq 1 ]
}

[ $# -gt 0 ] || set -- test-joint leg hrp2-like lift-gripper humanoid
for robot; do
    mkdir -p "$place/$robot"
    cp -r config robot-models "$place/$robot"
    pushd "$place/$robot" >/dev/null
    rm -rf "config/$robot/calibrations"
    cp "config/$robot/robot.toml" "config/$robot/calibrated.toml"
    case $robot in
    test-joint)
        record turning test-joint/calibration/hanging.toml 100
        calibrate turning.mcap
        ;;
    leg) # its contact set allows the foot to be touched
        record hanging leg/calibration/hanging.toml 120
        calibrate hanging.mcap --untouched
        ;;
    hrp2-like) # no link-side encoders: the F/T sensor alone
        record hanging leg/calibration/hanging.toml 120
        calibrate hanging.mcap --untouched
        ;;
    lift-gripper) # something is in the gripper for five seconds: no F/T sensor
        record lifting lift-gripper/calibration/lifting.toml 100
        calibrate lifting.mcap --only joints
        ;;
    humanoid)
        record hanging humanoid/calibration/hanging.toml 70 --harness chest_pitch_link
        record standing humanoid/calibration/standing.toml 60
        calibrate hanging.mcap standing.mcap
        ;;
    *)
        echo "there is no shipped robot $robot; allowed: test-joint, leg, hrp2-like, lift-gripper, humanoid" >&2
        exit 2
        ;;
    esac
    "$programs/torquectl" calibrate commit "config/$robot/calibrated.toml" calibrated
    "$programs/torquectl" calibrate status "config/$robot/calibrated.toml" || true
    popd >/dev/null
    rm -rf "config/$robot/calibrations"
    cp -r "$place/$robot/config/$robot/calibrations" "$place/$robot/config/$robot/calibrated.toml" "config/$robot"
    rm -rf "${place:?}/$robot"
done
