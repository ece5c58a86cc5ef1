#!/bin/bash
# A kernel with CAN as an ordinary process: User-Mode Linux on this machine's own files.
set -u
about='Runs COMMAND in User-Mode Linux, whose kernel has CAN: for what a test must do,
not for when (1 CPU, 100 Hz, no preemption).'
# shellcheck source-path=SCRIPTDIR source=lib.sh
. "$(dirname "$0")/lib.sh"

parse_options "$@"
need_root
need_program linux.uml
shim=$root_dir/target/vm/xstate_shim.so # for processors with AMX; see its source
[ -e "$shim" ] || die "target/vm/xstate_shim.so is missing; run rt-tests/install.sh"
prepare_results
cp "$vm_dir/uml_init.sh" "$results/.vm/init"

# One CPU, ahead of other work: each of the guest's system calls is a switch between processes,
# which costs five times as much across CPUs. Not under SCHED_FIFO: the kernel stops that for
# 50 ms a second.
cpu=$(taskset -cp $$ | grep -o '[0-9]*$')

# Two consoles: the kernel's into a file, the command's to our own output.
setsid taskset --cpu-list "$cpu" nice -n -20 \
    env LD_PRELOAD="$shim" linux.uml mem=2G root=/dev/root rootfstype=hostfs hostfs=/ ro quiet loglevel=4 \
    con=null con0=null,fd:2 con1=null,fd:1 \
    init="$results/.vm/init" RESULTS="$results" </dev/null 2>"$results/.vm/console.log" &
guest=$!
finish
