#!/bin/bash
# Kills processes and cuts buses on vcan as often as docs/results/safety-processes.md reports, and
# writes that page; ten minutes. Needs `./test vcan` to have run, which builds all of it.
# usage: rt-tests/vcan/kills.sh [--real-time]
#   --real-time   under PREEMPT_RT, natively or in QEMU (an hour), instead of User-Mode Linux
set -eu
cd "$(dirname "$0")/../.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")/debug
test=$(cargo test -p rt-tests --features rt-tests/vcan --test vcan_kills --no-run \
    --message-format json | grep -o '"executable":"[^"]*/vcan_kills[^"]*"' | cut -d '"' -f 4)
results=$PWD/target/test-logs/kills
options=("$@" --buses 2 --time-limit 7200 --results "$results")
for path in "$target"/{torqued,torqued-sim,examples/02_send_references} "$test" config robot-models; do
    options+=(--preload "$path")
done
code=0
rt-tests/vm/vcan.sh "${options[@]}" -- env TORQUED_BINARIES="$target" \
    KILLS_PAGE="$results/page.md" "$test" --nocapture processes || code=$?
# Also where a check fails: the page shows it.
cp "$results/page.md" docs/results/safety-processes.md
exit $code
