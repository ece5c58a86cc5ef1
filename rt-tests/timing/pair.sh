#!/bin/bash
# pair.sh BINARIES CONFIG: torqued and torqued-sim on a machine whose time counts. First
# undisturbed, for five seconds: their reports go to $RESULTS/{torqued,sim}.json. Then with
# the kernel counting what the loop's thread does, for two: $RESULTS/counts/EVENT.
set -eu
binaries=$1 config=$2
tracing=/sys/kernel/tracing

fail() {
    echo "pair.sh: $*" >&2
    exit 1
}

# wait_for STREAM PATTERN: reads lines until one has the pattern. Without a time limit of its
# own: the clock leaps while the guest loads files.
wait_for() {
    local line
    while read -r -u "$1" line; do
        echo "$line"
        [[ $line != *$2* ]] || return 0
    done
    fail "did not see '$2'"
}

start() { # SECONDS
    exec {sim_log}< <(exec "$binaries/torqued-sim" "$config" --json 2>&1)
    sim=$!
    wait_for $sim_log ready
    exec {torqued_log}< <(exec "$binaries/torqued" run "$config" --seconds "$1" --json 2>&1)
    torqued=$!
    wait_for $torqued_log running
}

finish() { # REPORTS: the folder for their last lines
    tail -n 1 <&$torqued_log | tee "$1/torqued.json"
    wait $torqued || fail "torqued ended with exit code $?"
    kill -TERM $sim
    tail -n 1 <&$sim_log | tee "$1/sim.json"
    wait $sim || fail "torqued-sim ended with exit code $?"
}

# The thread of torqued under SCHED_FIFO (policy 1, field 41 of its stat).
loop_thread() {
    awk '$(NF - 11) == 1 {print $1}' /proc/$torqued/task/*/stat
}

# Histograms that the kernel keeps: of the loop thread's system calls, and by thread of
# everything else. "count on" starts them, "count off" ends them.
heap=(malloc calloc realloc free posix_memalign aligned_alloc pthread_mutex_lock)
count() {
    local event what
    for event in raw_syscalls/sys_enter exceptions/page_fault_user "${heap[@]/#/torqued/}"; do
        what=hist:keys=common_pid
        if [ "$event" = raw_syscalls/sys_enter ]; then what="hist:keys=id if common_pid == $loop"; fi
        if [ "$1" = on ]; then
            echo "$what" >"$tracing/events/$event/trigger"
        else
            cat "$tracing/events/$event/hist" >"$RESULTS/counts/${event##*/}"
            echo "!$what" >"$tracing/events/$event/trigger"
        fi
    done
}

start 5
finish "$RESULTS"

mkdir -p "$RESULTS/counts"
grep -q " $tracing " /proc/mounts || mount -t tracefs tracefs $tracing
libc=$(ldd "$binaries/torqued" | awk '$1 == "libc.so.6" {print $3}')
nm -D --defined-only "$libc" | awk -v heap=" ${heap[*]} " -v libc="$libc" '
    {sub(/@.*/, "", $3)}
    index(heap, " " $3 " ") {print "p:torqued/" $3 " " libc ":0x" $1}' >>$tracing/uprobe_events
# Longer than the count by far: the clock leaps meanwhile, and a loop that ends frees what it had.
start 7
loop=$(loop_thread)
echo "$loop" >"$RESULTS/counts/loop_thread"
count on
sleep 2
count off
finish "$RESULTS/counts"
printf -- '-:torqued/%s\n' "${heap[@]}" >>$tracing/uprobe_events
