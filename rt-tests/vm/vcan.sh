#!/bin/bash
# Real CAN interfaces: from this machine's own kernel if it can, lent by another if not.
set -u
about='Runs COMMAND where there is a vcan: on this machine if its kernel has CAN, in
User-Mode Linux (uml.sh) if not. With --real-time as the first option: on this machine if
its kernel is PREEMPT_RT and has CAN, in QEMU (qemu_rt.sh) if not.'
# shellcheck source-path=SCRIPTDIR source=lib.sh
. "$(dirname "$0")/lib.sh"

virtual=uml.sh
if [ "${1:-}" = --real-time ]; then
    virtual=qemu_rt.sh
    shift
fi
parse_options "$@"
need_root

has_vcan() {
    modprobe -qa can_raw vcan 2>/dev/null
    grep -q '^CAN_RAW' /proc/net/protocols &&
        ip link add dev vcan_probe type vcan 2>/dev/null && ip link del vcan_probe
}
has_real_time() {
    [ $virtual = uml.sh ] || [ "$(cat /sys/kernel/realtime 2>/dev/null)" = 1 ]
}

if ! { has_real_time && has_vcan; }; then
    exec "$vm_dir/$virtual" "$@"
fi
prepare_results
setsid /bin/bash "$results/.vm/guest.sh" "$results" </dev/null &
guest=$!
finish
