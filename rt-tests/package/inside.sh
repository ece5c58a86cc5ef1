#!/bin/bash
# Inside of a fresh Debian, without systemd as its first process: what run.sh tests.
set -eu
. /lib.sh
# A daemon that still runs would keep the fresh system busy.
trap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT
# What an operator wrote stays, all else goes.
find / -xdev -path /proc -prune -o -path /sys -prune -o -path /dev -prune -o -path /tmp -prune -o -print | sort >/tmp/before
mkdir -p /etc/torqued

test_that 'the daemon is installed' dpkg -i /daemon.deb
test_that 'the clients are installed' dpkg -i /development.deb
test_that 'its user is there' getent passwd torqued
test_that 'the group of clients is there' getent group torqued-clients
test_that 'its directories are its own' test "$(stat -c %U:%a /run/torqued)" = torqued:700
test_that 'sudo accepts the rule of the group' visudo -c
useradd --create-home --groups torqued-clients somebody
test_that 'a member of the group is a client' runuser -u somebody -- sudo -n -u torqued true
test_that 'the unit is sound' systemd-analyze verify --man=no --recursive-errors=no torqued@leg.service
# Names of an ELF file's sections; the text .debug_info alone is in every Rust program.
test_that 'programs are stripped' python3 -c 'import struct
elf = open("/usr/bin/torqued", "rb").read()
at, = struct.unpack_from("<Q", elf, 0x28)
size, count, names = struct.unpack_from("<3H", elf, 0x3A)
place, length = struct.unpack_from("<2Q", elf, at + names * size + 0x18)
assert b".text" in elf[place:place + length] and b".debug_info" not in elf[place:place + length]'
test_that 'there is a manual page' test -s /usr/share/man/man1/torquectl-doctor.1.gz
test_that 'there is a completion' bash -c 'source /usr/share/bash-completion/completions/torquectl && complete -p torquectl'
test_that 'licences of what is inside are there' grep -q 'iceoryx2' /usr/share/doc/torqued/copyright
test_that 'the Python client is whole' python3 -c 'import ast, pathlib
for file in pathlib.Path("/usr/lib/python3/dist-packages/torqued").glob("*.py"): ast.parse(file.read_text())'
test_that 'libtorqued can be loaded' python3 -c 'import ctypes; ctypes.CDLL("/usr/lib/libtorqued.so.0")'

cp -r /usr/share/torqued/examples /etc/torqued/examples
leg=/etc/torqued/examples/config/leg/robot.toml
test_that 'the example is a sound configuration' torquectl check "$leg"
test_that 'its keys are shown' torquectl config show "$leg"
# A container has findings (its kernel is no real-time kernel), but no defect of the package.
diagnosis() {
    local code=0
    torquectl doctor --json "$1" >/tmp/doctor.json || code=$?
    [ $code -le 1 ] && python3 - <<'END'
import json
found = {finding["id"] for finding in json.load(open("/tmp/doctor.json"))["findings"]}
assert not found & {"user", "run-directory", "run-directory-owner", "state-directory", "unit-rtprio", "unit-memlock", "shm", "shm-leftovers"}, found
assert "can-missing" in found, found
END
}
test_that 'the doctor finds nothing wrong with the package' diagnosis "$leg"
as_robot torqued run "$leg" --simulate --seconds 12 --json >/tmp/summary.json 2>/tmp/daemon.log &
daemon=$!
sleep 5
test_that 'a simulated robot runs' as_robot torquectl state
test_that 'its records can be read' as_robot torquectl watch --once
test_that 'its times can be read' as_robot torquectl timing
test_that 'its figures are served' bash -c "runuser -u torqued -- env TORQUED_RUN_DIR=/run/torqued torquectl metrics --once | grep -q '^torqued_up 1'"
test_that 'the daemon ends well' wait $daemon
test_that 'it has run its cycles' python3 -c 'import json; assert json.load(open("/tmp/summary.json"))["cycles"] > 1000'
test_that 'nothing is left in shared memory' test -z "$(ls /dev/shm | grep -v '[.]global_mgmt$')"

test_that 'an upgrade is an installation over it' dpkg -i /daemon.deb
rm -r /etc/torqued/examples
test_that 'the clients are removed' dpkg --purge torqued-dev
test_that 'the daemon is purged' dpkg --purge torqued
userdel --remove somebody 2>/dev/null
find / -xdev -path /proc -prune -o -path /sys -prune -o -path /dev -prune -o -path /tmp -prune -o -print | sort >/tmp/after
left() { comm -13 /tmp/before /tmp/after | grep -vE '^/(var/(lib/dpkg|cache|log|mail)|etc/(passwd|shadow|group|gshadow|subuid|subgid)|run)(-|/|$)' >/tmp/left; ! [ -s /tmp/left ] || { cat /tmp/left; false; }; }
test_that 'nothing of it is left' left
echo "== $passed passed in ${SECONDS}s =="
