#!/bin/bash
# Runs where the CAN interfaces are to be: brings them up, runs the command, and leaves
# its exit code. Argument: the results folder.
# shellcheck disable=SC2154
set -u
# Written by lib.sh: buses, preload, command, directory.
# shellcheck source=/dev/null
. "$1/.vm/settings"

ip link set lo up
made=()
for ((i = 0; i < buses; i++)); do
    if ! [ -e "/sys/class/net/vcan$i" ]; then
        ip link add dev "vcan$i" type vcan || exit 1
        made+=("vcan$i")
    fi
    # 72 bytes: CAN FD frames pass as well as classic ones.
    ip link set "vcan$i" mtu 72 up || exit 1
done

# Rewriting a file's time stamps as they are makes the overlay copy it into memory.
for path in "${preload[@]}"; do
    find "$path" -type f -exec touch -c -r '{}' '{}' ';'
done

cd "$directory" || exit 1
"${command[@]}"
echo $? >"$1/.vm/exit_code"

for interface in "${made[@]}"; do ip link del "$interface"; done
