# For scripts that test a fresh Debian from inside.
export DEBIAN_FRONTEND=noninteractive LC_ALL=C PATH=/usr/sbin:/usr/bin:/sbin:/bin
passed=0
# test_that WHAT COMMAND...: counts it; a failure ends the script, with the command's output and that of `explain`.
test_that() {
    local what=$1
    shift
    if "$@" >/tmp/log 2>&1; then
        passed=$((passed + 1))
        echo "ok: $what"
    else
        echo "FAILED: $what"
        cat /tmp/log
        ! declare -F explain >/dev/null || explain
        echo "== $passed passed, 1 failed in ${SECONDS}s =="
        exit 1
    fi
}
as_robot() { runuser -u torqued -- env HOME=/var/lib/torqued TORQUED_RUN_DIR=/run/torqued "$@"; }
