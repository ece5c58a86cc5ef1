#!/bin/bash
# Bounded fuzzing of what reads files and frames from outside (crates/*/fuzz), with the pinned
# stable compiler: libFuzzer and LLVM's coverage pass, no cargo-fuzz.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
cd "$root"

usage() {
    cat <<END
usage: rt-tests/fuzz.sh [--keep] [SECONDS [TARGET...]]

Fuzzes each target for SECONDS (60) of processor time, one on each CPU: $(echo "${targets[@]##*:}")
Starts from the corpus in crates/*/fuzz/corpus: TARGET/ holds inputs with a name (seeds,
regressions), TARGET.tar.gz those that the fuzzer found. Inputs that find new paths collect in
target/fuzz/corpus. Exit code 0 if nothing crashed; else the input is in target/fuzz/crashes.
  --keep     adds to the archive one input for each edge of the program that was found anew
Examples:
  rt-tests/fuzz.sh
  rt-tests/fuzz.sh --keep 600 urdf
END
}

# CRATE:TARGET of each.
mapfile -t targets < <(find crates/*/fuzz/fuzz_targets -name '*.rs' |
    sed -E 's,crates/([^/]*)/fuzz/fuzz_targets/(.*)\.rs,\1:\2,' | sort)
keep=no
case ${1:-} in
    -h | --help) usage; exit 0 ;;
    --keep) keep=yes; shift ;;
esac
seconds=${1:-60}
if ! [[ $seconds =~ ^[0-9]+$ ]]; then
    echo "fuzz: '$seconds'; allowed: a number of seconds, --keep, --help" >&2
    exit 2
fi
shift || true
[ $# -gt 0 ] || set -- "${targets[@]##*:}"

# What cargo-fuzz sets, without the sanitizers: our code has no unsafe block there to watch.
coverage=(-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table
    -Cllvm-args=-sanitizer-coverage-trace-compares
    --cfg=fuzzing -Cdebug-assertions)
# Half the time to build, for somewhat slower programs, whose corpora hold what was found before.
export CARGO_PROFILE_RELEASE_OPT_LEVEL=1 CARGO_PROFILE_RELEASE_DEBUG=none
host=$(rustc -vV | sed -n 's/^host: //p')

rt-tests/install.sh --fuzz
crate_of() {
    local crate
    crate=$(printf '%s\n' "${targets[@]}" | sed -n "s/:$1\$//p")
    [ -n "$crate" ] || { echo "fuzz: no target '$1'; allowed: ${targets[*]##*:}" >&2; exit 2; }
    echo "$crate"
}

# All are built before the first runs: a target that no longer compiles is found at once.
for target in "$@"; do
    crate=$(crate_of "$target")
    # With --target the flags do not reach build scripts.
    RUSTFLAGS="${coverage[*]}" cargo build --release --locked --quiet \
        --manifest-path "crates/$crate/fuzz/Cargo.toml" \
        --bin "$target" --target "$host" --target-dir target/fuzz
done

# end_after SECONDS PROCESS: asks a fuzzer to end once it has had that much processor time: time on a clock would be
# less work where others run as well.
end_after() {
    local stat ticks
    ticks=$(($1 * $(getconf CLK_TCK)))
    while read -r -a stat 2>/dev/null <"/proc/$2/stat"; do
        # Times in user and kernel mode; the name, second, has no blank.
        [ $((stat[13] + stat[14])) -lt $ticks ] || { kill -USR1 "$2" 2>/dev/null || true; return; }
        sleep 0.5
    done
}

# Fuzzes one target; prints what it found.
fuzz() {
    local target=$1 folder named archive found crashes program unpacked log
    folder=crates/$(crate_of "$target")/fuzz
    named=$folder/corpus/$target archive=$folder/corpus/$target.tar.gz
    found=target/fuzz/corpus/$target crashes=target/fuzz/crashes/$target
    program=target/fuzz/$host/release/$target
    local options=(-max_len=4096 -timeout=10 -rss_limit_mb=2048 -print_final_stats=1)
    [ ! -e "$folder/$target.dict" ] || options+=(-dict="$folder/$target.dict")
    unpacked=target/fuzz/unpacked/$target
    rm -rf "$unpacked"
    mkdir -p "$found" "$crashes" "$unpacked"
    [ ! -e "$archive" ] || tar -xzf "$archive" -C "$unpacked"
    log=target/fuzz/$target.log
    "$program" "${options[@]}" -artifact_prefix="$crashes/" "$found" "$unpacked" "$named" >"$log" 2>&1 &
    end_after "$seconds" $!
    if ! wait $!; then
        tail -n 40 "$log"
        echo "fuzz: $target failed; input in $crashes, log in $log" >&2
        return 1
    fi
    echo "== fuzz $target, $seconds s of processor time"
    grep -E '^(stat::number_of_executed_units|stat::new_units_added)' "$log"
    [ $keep = no ] || {
        # One input for each new edge; how often an edge is taken would keep three times as many.
        "$program" -merge=1 -use_cmp=0 -use_counters=0 "${options[@]}" "$unpacked" "$named" "$found" 2>&1 |
            tail -n 1
        # The same inputs make the same archive.
        tar -C "$unpacked" --sort=name --mtime=@0 --owner=0 --group=0 --numeric-owner -cf - . |
            gzip -9n >"$archive"
    }
}

# One on each CPU. All run to their end, also where one fails.
running=0 failed=0
next() { wait -n || failed=1; running=$((running - 1)); }
for target in "$@"; do
    [ $running -lt "$(nproc)" ] || next
    fuzz "$target" &
    running=$((running + 1))
done
while [ $running -gt 0 ]; do next; done
exit $failed
