#!/bin/bash
# Tests of UDP buses, rt-tests/udp and rt-tests/second-robot, in a network of their own, so that no frame
# leaves the machine and the group is nobody else's. Where the system gives no network of one's own they
# are skipped, and counted as such.
set -u
cd "$(dirname "$0")/../.." || exit 1
tests=(.venv/bin/pytest rt-tests/udp rt-tests/second-robot "$@")
own='ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'
if [ "$(id -u)" = 0 ]; then network=(unshare -n); else network=(unshare -rn); fi
if why=$("${network[@]}" sh -c "$own" sh true 2>&1); then
    exec "${network[@]}" env TORQUED_OWN_NETWORK=yes sh -c "$own" sh "${tests[@]}"
fi
echo "udp: no network of its own: ${network[*]}: $why" >&2
TORQUED_OWN_NETWORK="no: $why" exec "${tests[@]}"
