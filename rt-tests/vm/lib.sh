# What uml.sh, qemu_rt.sh and vcan.sh share: options, the folder that guest and host
# both see, and the guest's time limit. Sourced, not run.
# shellcheck shell=bash disable=SC2034,SC2154

vm_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root_dir=$(cd "$vm_dir/../.." && pwd)

buses=2 time_limit=120 results='' keep_results=yes preload=() command=()

die() {
    echo "$(basename "$0"): $*" >&2
    exit 2
}

usage() {
    cat <<END
usage: $(basename "$0") [--buses N] [--time-limit S] [--results DIR] -- COMMAND...

$about

The command sees this machine's files (its own changes to them are lost), starts in
this folder, and gets the interfaces vcan0 ... vcan(N-1), up, with CAN FD. The folder
\$RESULTS, which is DIR, is the one place where what it writes stays. Its exit code is
passed back; 2 is a wrong option, 124 a run past the time limit, 125 a guest that died.

  --buses N        number of vcan interfaces (default 2)
  --time-limit S   seconds after which the guest is killed (default 120)
  --results DIR    made if missing (default: a folder that is removed at the end)
  --preload PATH   a file, or a folder with all its files, that the guest copies into its
                   memory before it starts COMMAND; may be repeated
END
}

parse_options() {
    while [ $# -gt 0 ]; do
        case $1 in
            --buses | --time-limit | --results | --preload)
                [ $# -gt 1 ] || die "$1 needs a value; see --help" ;;&
            --buses) buses=$2; shift 2 ;;
            --time-limit) time_limit=$2; shift 2 ;;
            --results) results=$2; shift 2 ;;
            --preload) preload+=("$(realpath -e "$2")") || die "--preload $2: no such file"; shift 2 ;;
            --) shift; command=("$@"); break ;;
            -h | --help) usage; exit 0 ;;
            *) die "unknown option '$1'; allowed: --buses --time-limit --results --preload --help, then -- COMMAND" ;;
        esac
    done
    [[ $buses =~ ^[0-9]+$ ]] || die "--buses $buses: allowed: a whole number"
    [[ $time_limit =~ ^[1-9][0-9]*$ ]] || die "--time-limit $time_limit: allowed: whole seconds, at least 1"
    [ ${#command[@]} -gt 0 ] || die "no command; write it after --; see --help"
}

need_root() {
    [ "$(id -u)" = 0 ] || die "needs root (mounts, network interfaces); use sudo"
}

# need_program PROGRAM: the install step has brought it.
need_program() {
    command -v "$1" >/dev/null || die "$1 is missing; run rt-tests/install.sh"
}

# Makes $results, and in it .vm/ with what the guest has to know.
prepare_results() {
    if [ -z "$results" ]; then
        results=$(mktemp -d /tmp/vcan.XXXXXX)
        keep_results=no
    fi
    mkdir -p "$results" || die "--results $results: cannot be made"
    results=$(realpath "$results")
    # The guest gets these paths on its kernel's command line.
    [[ $results =~ [[:space:],] ]] && die "--results $results: allowed: a path without spaces and commas"
    rm -rf "$results/.vm"
    mkdir "$results/.vm"
    cp "$vm_dir/guest.sh" "$results/.vm/"
    {
        declare -p buses preload command
        printf 'directory=%q\n' "$PWD"
        printf 'export RESULTS=%q PATH=%q HOME=%q LC_ALL=C.UTF-8 RUST_BACKTRACE=1\n' \
            "$results" "$PATH" "${HOME:-/root}"
    } >"$results/.vm/settings"
    trap 'stop_guest' EXIT
    trap 'exit 130' INT TERM HUP
}

guest='' # the guest's process id, which is its process group's too

# Runs once, however we end: a guest never outlives its script.
stop_guest() {
    # shellcheck disable=SC2317 # reached from the trap
    [ -z "$guest" ] || { kill -KILL -- "-$guest"; wait "$guest"; } 2>/dev/null
    if [ "$keep_results" = no ]; then rm -rf "$results"; fi
}

# Waits for $guest, kills it at the time limit, and ends with the command's exit code.
finish() {
    timeout "$time_limit" tail --pid="$guest" --sleep-interval=0.05 -f /dev/null &
    if ! wait $!; then
        echo "$(basename "$0"): not done after $time_limit s (--time-limit): guest killed" >&2
        exit 124
    fi
    local code
    if ! code=$(cat "$results/.vm/exit_code" 2>/dev/null); then
        tail -n 20 "$results/.vm/console.log" >&2 2>/dev/null
        echo "$(basename "$0"): the guest ended without an exit code of the command" >&2
        exit 125
    fi
    exit "$code"
}
