#!/bin/bash
# The service where systemd is the first process: the fresh Debian with the package, booted in User-Mode Linux, with
# a simulated joint on a virtual CAN bus. Called by run.sh.
# usage: machine.sh ROOT; as root. ROOT: a fresh Debian in which the package can be installed.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
fresh=$1
shim=$root/target/vm/xstate_shim.so # for processors with AMX; see its source
results=/machine.txt

chroot "$fresh" dpkg -i /daemon.deb >"$fresh/install.txt" 2>&1 || { cat "$fresh/install.txt" >&2; exit 1; }
# CAN of the machine's kernel.
modules=$(echo /usr/lib/uml/modules/*)
mkdir -p "$fresh/usr/lib/torqued-test"
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    cp "$modules/kernel/$module.ko" "$fresh/usr/lib/torqued-test/"
done

# One joint at 200 Hz: a system call costs 20 us and more there (rt-tests/vcan/conftest.py).
joint=$fresh/etc/torqued/test-joint models=/usr/share/torqued-test
mkdir -p "$joint" "$fresh$models"
cp "$root"/config/test-joint/*.toml "$joint/"
cp -r "$root/robot-models/test-joint" "$fresh$models/"
# What an unprivileged program writes to the host's files would be root's.
echo "tmpfs /var/lib/torqued tmpfs size=16M 0 0" >>"$fresh/etc/fstab"
sed -i -e "s,\.\./\.\./robot-models/,$models/,g" -e 's/rate_hz = 1000.0/rate_hz = 200.0/' \
    -e 's/gather_deadline_us = 400.0/gather_deadline_us = 4500.0/' -e 's/stale_after_ms = 20.0/stale_after_ms = 200.0/' \
    -e 's/reference_timeout_ms = 40.0/reference_timeout_ms = 500.0/' -e 's/enable = "automatic"/enable = "operator"/' \
    -e 's/^\[safety\]/[safety]\npublisher_timeout_ms = 10000.0/' "$joint"/*.toml

unit() { cat >"$fresh/etc/systemd/system/$1"; }
unit bus.service <<END
[Unit]
Description=Virtual CAN bus
Before=network.target
Wants=network.target
[Service]
Type=oneshot
RemainAfterExit=yes
WorkingDirectory=/usr/lib/torqued-test
ExecStart=/bin/sh -c 'for m in can can-raw can-dev vcan; do insmod ./\$m.ko; done'
ExecStart=/bin/sh -c 'ip link add vcan0 type vcan; ip link set vcan0 mtu 72 txqueuelen 128 up'
[Install]
WantedBy=multi-user.target
END
unit drives.service <<END
[Unit]
Description=A simulated joint
Before=network.target
Wants=network.target
After=bus.service
[Service]
Type=notify
ExecStart=/usr/bin/torqued-sim /etc/torqued/test-joint/robot.toml
[Install]
WantedBy=multi-user.target
END
unit tests.service <<END
[Unit]
Description=Tests of the service
After=multi-user.target
[Service]
Type=oneshot
StandardOutput=append:$results
StandardError=inherit
ExecStart=/bin/bash /service.sh
ExecStopPost=/bin/systemctl --force --force poweroff
[Install]
WantedBy=multi-user.target
END
mkdir -p "$fresh/etc/systemd/system/torqued@test-joint.service.d"
unit torqued@test-joint.service.d/no-real-time.conf <<END
[Service]
LimitRTPRIO=0
AmbientCapabilities=
AmbientCapabilities=CAP_IPC_LOCK
END
for unit in bus drives tests torqued@test-joint; do
    chroot "$fresh" systemctl --quiet enable "$unit.service"
done
cp "$here/service.sh" "$fresh/service.sh"

echo "== systemd as the first process"
code=0
env LD_PRELOAD="$shim" timeout 600 linux.uml mem=1G root=/dev/root rootfstype=hostfs hostfs="$fresh" rw quiet loglevel=4 \
    con=null con0=null,fd:2 init=/lib/systemd/systemd </dev/null >"$fresh/console.txt" 2>&1 || code=$?
if ! [ -s "$fresh$results" ] || ! grep -q '^== .* passed in ' "$fresh$results"; then
    tail -n 30 "$fresh/console.txt"
    cat "$fresh$results" 2>/dev/null
    echo "machine.sh: the tests did not come to their end (code $code of the machine)" >&2
    exit 1
fi
cat "$fresh$results"
