#!/bin/bash
# Real CAN interfaces: from this machine's own kernel if it can, lent by another if not.
set -u
about='Runs COMMAND where there is a vcan: on this machine if its kernel has CAN, in
User-Mode Linux (uml.sh) if not, in QEMU (qemu_rt.sh, slower) where that does not start. With --real-time as the first option: on this machine if
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
    if [ $virtual = uml.sh ]; then
        "$vm_dir/uml.sh" --buses 0 --time-limit 60 -- true
        case $? in
            0) ;;
            124 | 125)
                echo "vcan.sh: User-Mode Linux does not start on this machine, see above: using QEMU, which is slower" >&2
                virtual=qemu_rt.sh
                ;;
            *) exit 2 ;;
        esac
    fi
    exec "$vm_dir/$virtual" "$@"
fi
prepare_results
setsid /bin/bash "$results/.vm/guest.sh" "$results" </dev/null &
guest=$!
finish
