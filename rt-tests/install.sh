#!/bin/bash
# What the tests need on a Debian machine that has Rust and Python 3.11: Debian packages
# and a kernel for the virtual machines, and a Python environment in .venv.
# Does nothing, quickly, where all is there.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
cd "$root"

usage() {
    cat <<END
usage: rt-tests/install.sh [--package] [--python] [--vm] [--client] [--browser] [--bench] [--fuzz]

Installs what ./test needs; without options, --python, --vm, --client,
--browser and --package.
  --python   the Python environment .venv (rt-tests/python/requirements.txt)
  --vm       Debian packages for the virtual machines, the PREEMPT_RT kernel
             that the timing test boots (unpacked into target/vm, not installed), and what
             User-Mode Linux needs on processors with AMX (compiled into target/vm)
  --client   Debian packages for the tests of the C and C++ client
  --browser  Debian's headless Chromium, for the test of the page of torquectl view
  --package  Debian packages for the packages and their test
  --bench    Debian packages for benches/dynamics/run.sh
  --fuzz     Debian packages for rt-tests/fuzz.sh
END
}

step() { echo "install: $*"; }

as_root() {
    if [ "$(id -u)" = 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo "$@"
    else
        echo "install: '$*' needs root, and there is no sudo: run this as root" >&2
        exit 1
    fi
}

# packages NAME...: installs those that are missing.
packages() {
    local missing=() name
    for name in "$@"; do
        [ "$(dpkg-query -W -f='${db:Status-Status}' "$name" 2>/dev/null)" = installed ] || missing+=("$name")
    done
    [ ${#missing[@]} -gt 0 ] || return 0
    step "Debian packages: ${missing[*]}"
    apt_lists
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=120 -qq \
        install -y --no-install-recommends "${missing[@]}" >/dev/null
}

# Fresh package lists, once a run.
lists_fresh=no
apt_lists() {
    [ $lists_fresh = no ] || return 0
    as_root apt-get -o DPkg::Lock::Timeout=120 -qq update
    lists_fresh=yes
}

install_vm() {
    packages user-mode-linux qemu-system-x86 busybox-static cpio kmod iproute2 procps gcc libc6-dev
    local folder=$root/target/vm
    mkdir -p "$folder"
    if ! [ "$folder/xstate_shim.so" -nt rt-tests/vm/xstate_shim.c ]; then
        step "shim for User-Mode Linux into target/vm"
        gcc -O2 -Wall -Wextra -shared -fPIC rt-tests/vm/xstate_shim.c -o "$folder/xstate_shim.so" -ldl
    fi
    # Made anew when the first process, which is in it, or what makes it has changed.
    local made=$folder/rt-kernel/initramfs
    ! [[ $made -nt rt-tests/vm/qemu_init.sh && $made -nt rt-tests/vm/make_initramfs.sh ]] || return 0
    step "PREEMPT_RT kernel (70 MB) into target/vm/rt-kernel"
    apt_lists
    rm -rf "$folder/rt-kernel" "$folder/new"
    mkdir -p "$folder/new"
    local package
    package=$(apt-cache depends linux-image-rt-amd64 | awk '$1 == "Depends:" {print $2; exit}')
    [ -n "$package" ] || { echo "install: no Debian package linux-image-rt-amd64" >&2; exit 1; }
    (cd "$folder/new" && apt-get -qq -o APT::Sandbox::User=root download "$package" && dpkg -x ./*.deb tree)
    "$root/rt-tests/vm/make_initramfs.sh" "$folder/new/tree" "$folder/new/kernel"
    mv "$folder/new/kernel" "$folder/rt-kernel"
    rm -r "$folder/new"
}

install_bench() { packages clang clang-19 python3-venv; }

install_client() { packages gcc g++ libc6-dev pkg-config binutils; }

install_browser() {
    command -v chromium-headless-shell >/dev/null || command -v chromium >/dev/null ||
        packages chromium-headless-shell fonts-dejavu-core
}

install_package() { packages mmdebstrap binutils; }

install_fuzz() { packages g++; }

install_python() {
    local wanted=rt-tests/python/requirements.txt
    ! cmp -s "$wanted" .venv/requirements.txt || return 0
    step "Python environment .venv"
    python3 -c 'import ensurepip' 2>/dev/null || packages python3-venv
    python3 -m venv --clear .venv
    .venv/bin/pip install --disable-pip-version-check --quiet --progress-bar on -r "$wanted"
    cp "$wanted" .venv/requirements.txt # last: says that all of it is there
}

[ $# -gt 0 ] || set -- --vm --python --client --browser --package
for option in "$@"; do
    case $option in
        --vm) install_vm ;;
        --python) install_python ;;
        --client) install_client ;;
        --browser) install_browser ;;
        --package) install_package ;;
        --bench) install_bench ;;
        --fuzz) install_fuzz ;;
        -h | --help) usage; exit 0 ;;
        *) echo "install: unknown option '$option'; allowed: --python --vm --client --browser --package --bench --fuzz --help" >&2; exit 2 ;;
    esac
done
