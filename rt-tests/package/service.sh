#!/bin/bash
# Inside of a machine whose first process is systemd, with the package, a bus and a simulated joint: what machine.sh
# tests. It has begun after everything that the machine starts.
set -eu
. /lib.sh
unit=torqued@test-joint.service
explain() { systemctl --no-pager --full status "$unit" drives bus || true; journalctl --no-pager --lines 60 || true; }
property() { systemctl show --property "$1" --value "$unit"; }
main_pid() { property MainPID; }
state() { as_robot torquectl state --json | python3 -c 'import json, sys; print(json.load(sys.stdin)["state"])'; }
# within SECONDS COMMAND...: it succeeds by then.
within() {
    local until=$((SECONDS + $1))
    shift
    until "$@" >/dev/null 2>&1; do
        [ $SECONDS -lt $until ] || { "$@"; return 1; }
        sleep 0.2
    done
}
is_state() { [ "$(state)" = "$1" ]; }
is_up_but_for() { local pid; pid=$(main_pid); [ "$pid" != 0 ] && [ "$pid" != "$1" ] && [ "$(property SubState)" = running ]; }
in_journal() { journalctl --quiet --no-pager --output cat --unit "$unit" | grep -q -e "$1"; }
restarts() { [ "$(property NRestarts)" = "$1" ]; }

is_active() { [ "$(property ActiveState)" = active ]; }
test_that 'the service was started with the machine' within 30 is_active
test_that 'nothing that the machine starts has failed' test -z "$(systemctl --failed --plain --no-legend)"
# Its start, us since boot, after the bus'.
started_after() { [ "$(property ExecMainStartTimestampMonotonic)" -gt "$(systemctl show --property ActiveEnterTimestampMonotonic --value "$1")" ]; }
test_that 'it was started after the bus was up' started_after bus.service
test_that 'it was not started in vain' restarts 0
test_that 'the unit is sound' systemd-analyze verify --man=no "$unit"
exposure() { systemd-analyze security --no-pager "$unit" | grep 'Overall exposure' | python3 -c 'import re, sys; x = float(re.search(r": ([0-9.]+)", sys.stdin.read())[1]); print(x); assert x <= 2.0'; }
test_that 'its exposure is 2.0 at most' exposure
test_that 'the loop is ready' within 30 is_state ready
test_that 'an operator enables the robot' as_robot torquectl enable
test_that 'the robot is held' is_state holding

before=$(main_pid)
test_that 'reload brings it to rest' systemctl reload "$unit"
test_that 'and does not end it' test "$(main_pid)" = "$before"

kill -KILL "$before"
test_that 'killed in hold it is started again' within 20 is_up_but_for "$before"
test_that 'systemd has counted it' restarts 1
# What the drives did meanwhile is a fault, or the robot waits for an operator: it does not go on by itself.
waits() { case $(state) in fault | ready) ;; *) false ;; esac; }
test_that 'it then waits for an operator' within 30 waits
if is_state fault; then
    test_that 'the fault is acknowledged' as_robot torquectl acknowledge
fi
test_that 'the robot is enabled again' within 30 as_robot torquectl enable
test_that 'the robot is held again' is_state holding

before=$(main_pid)
kill -STOP "$before"
test_that 'a loop that hangs is ended by the watchdog and started again' within 30 is_up_but_for "$before"
test_that 'the journal has the reason' within 5 in_journal 'Watchdog timeout'
test_that 'it waits for an operator again' within 30 waits

fields() {
    journalctl --quiet --no-pager --output json --unit "$unit" | python3 -c '
import json, sys
own = [entry for entry in map(json.loads, sys.stdin) if entry.get("_COMM", "").startswith("torqued")]
print(sorted({key for entry in own for key in entry}))
assert {"3", "4", "5", "6"} & {entry["PRIORITY"] for entry in own}
assert any("EVENT" in key or "STATE" in key for entry in own for key in entry)'
}
test_that 'its messages in the journal have level and fields' fields

systemctl stop "$unit"
test_that 'stopped it ends well' test "$(property Result):$(property ExecMainStatus)" = success:0
test_that 'nothing is left in shared memory' test -z "$(ls /dev/shm | grep -v '[.]global_mgmt$')"
echo "== $passed passed in ${SECONDS}s =="
