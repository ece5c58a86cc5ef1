#!/bin/bash
# Installs the packages into a fresh Debian, diagnoses it, checks and runs a simulated robot, removes all of it; then
# boots such a system, with systemd as its first process, and tests the service (machine.sh).
# usage: rt-tests/package/run.sh DAEMON.deb DEVELOPMENT.deb; as root. The fresh system is kept as
# target/package-root.tar: the first run makes it (two to three minutes), later ones unpack it.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
daemon=$(realpath "$1") development=$(realpath "$2")
archive=$root/target/package-root.tar

if ! [ "$archive" -nt "$here/run.sh" ]; then
    suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
    sources=()
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/*; do
        [ ! -s "$file" ] || sources+=("$file")
    done
    # Only what the packages recommend: systemd for users and units, iproute2 and kmod for CAN; Python for its client.
    mmdebstrap --quiet --variant=minbase --include=systemd,iproute2,sudo,python3,kmod "$suite" "${archive%.tar}.new.tar" "${sources[@]}"
    mv "${archive%.tar}.new.tar" "$archive"
fi
fresh=$(mktemp -d)
clean() {
    umount "$fresh/dev/shm" 2>/dev/null || true
    umount -R "$fresh/proc" "$fresh/sys" "$fresh/dev" 2>/dev/null || true
    rm -rf --one-file-system "$fresh"
}
trap clean EXIT
tar -C "$fresh" -xf "$archive" --exclude './dev/*'
mkdir -p "$fresh/dev/shm"
cp "$daemon" "$fresh/daemon.deb"
cp "$development" "$fresh/development.deb"
cp "$here/inside.sh" "$here/lib.sh" "$fresh/"
mount -t proc proc "$fresh/proc"
mount -t sysfs sysfs "$fresh/sys" -o ro
mount --bind /dev "$fresh/dev"
mount -t tmpfs -o size=128M tmpfs "$fresh/dev/shm"
chroot "$fresh" /bin/bash /inside.sh
umount "$fresh/dev/shm" "$fresh/proc" "$fresh/sys" "$fresh/dev"
"$here/machine.sh" "$fresh"
