#!/bin/bash
# A PREEMPT_RT kernel on a counted machine: QEMU executes 1000 million instructions per
# second of its own virtual time, so that two runs are the same to the nanosecond, whatever
# else this machine does.
set -u
about='Runs COMMAND under a PREEMPT_RT kernel in QEMU with counted instructions: for what a
test must do in time. Time inside is virtual. While the guest reads this machine'\''s files
its clock leaps: name with --preload what the measured part opens.'
# shellcheck source-path=SCRIPTDIR source=lib.sh
. "$(dirname "$0")/lib.sh"

parse_options "$@"
need_root
need_program qemu-system-x86_64
kernel=$root_dir/target/vm/rt-kernel
[ -e "$kernel/initramfs" ] || die "no kernel in target/vm/rt-kernel; run rt-tests/install.sh"
prepare_results

share() { # TAG FOLDER OPTIONS
    echo "local,mount_tag=$1,path=$2,security_model=none,multidevs=remap$3"
}
# Never KVM: instructions cannot be counted there. /dev/kvm may also exist and hang.
setsid qemu-system-x86_64 -nodefaults -no-user-config -display none -no-reboot \
    -accel tcg,thread=single -cpu max -smp 1 -m 2G \
    -icount shift=0,sleep=off,align=off -rtc clock=vm \
    -kernel "$kernel/vmlinuz" -initrd "$kernel/initramfs" \
    -append "console=ttyS0 quiet panic=-1 mitigations=off RESULTS=$results" \
    -virtfs "$(share host / ,readonly=on)" -virtfs "$(share results "$results" '')" \
    -serial "file:$results/.vm/console.log" -serial stdio </dev/null &
guest=$!
finish
