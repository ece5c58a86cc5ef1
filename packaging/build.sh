#!/bin/bash
# Makes what one installs: two Debian packages and a Python wheel. docs/install.md says what is in them.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
cd "$root"

usage() {
    cat <<END
usage: packaging/build.sh [--binaries FOLDER] [--output FOLDER]

Makes, of a release build or of binaries that are built already:
  torqued_VERSION_ARCH.deb       daemon, torquectl, service, manual pages, completions, examples
  torqued-dev_VERSION_ARCH.deb   C and C++ headers, libtorqued, Python client
  torqued-VERSION-py3-none-any.whl

  --binaries FOLDER  take torqued, torqued-sim, torquectl and libtorqued_c.so from there, e.g. target/debug
  --output FOLDER    [default: target/package]

Needs binutils and dpkg, and Python 3 with pip (rt-tests/install.sh makes .venv).
END
}

target=${CARGO_TARGET_DIR:-$root/target}
binaries='' output=$target/package
while [ $# -gt 0 ]; do
    case $1 in
        --binaries) binaries=$(realpath "${2:?--binaries needs a folder}"); shift 2 ;;
        --output) output=$(realpath -m "${2:?--output needs a folder}"); shift 2 ;;
        -h | --help) usage; exit 0 ;;
        *) echo "build.sh: unknown option '$1'; allowed: --binaries --output --help" >&2; exit 2 ;;
    esac
done
if [ -z "$binaries" ]; then
    cargo build --release --locked -p torqued -p torquectl -p torqued-c
    binaries=$target/release
fi

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
arch=$(dpkg --print-architecture)
python=$root/.venv/bin/python
[ -x "$python" ] || python=python3
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
mkdir -p "$output"

# The newest version of the C library that a program asks for: with an older one it does not start.
libc_needed() {
    local newest
    newest=$(objdump -T "$@" | grep -oE 'GLIBC_[0-9.]+' | sed 's/GLIBC_//' | sort -V | tail -n 1)
    [ -n "$newest" ] || { echo "build.sh: $* asks for no C library: not what cargo builds" >&2; return 1; }
    echo "$newest"
}

# pack NAME TREE BINARIES...: the package of a tree.
pack() {
    local name=$1 tree=$2 size
    shift 2
    size=$(du -sk --exclude=DEBIAN "$tree" | cut -f 1)
    sed -e "s/@VERSION@/$version/" -e "s/@ARCH@/$arch/" -e "s/@SIZE@/$size/" \
        -e "s/@LIBC@/$(libc_needed "$@")/" "packaging/debian/$name.control" >"$tree/DEBIAN/control"
    (cd "$tree" && find . -type f ! -path './DEBIAN/*' -printf '%P\0' | sort -z | xargs -0 md5sum) >"$tree/DEBIAN/md5sums"
    dpkg-deb --root-owner-group --build "$tree" "$output/${name}_${version}_$arch.deb" >/dev/null
    echo "$output/${name}_${version}_$arch.deb"
}

licences() {
    install -d "$1/usr/share/doc/$2"
    install -m 644 LICENSE LICENSE-MIT LICENSE-APACHE "$1/usr/share/doc/$2"
    "$python" packaging/licences.py "$3" >"$1/usr/share/doc/$2/copyright"
}

daemon() {
    local tree=$stage/torqued program robot
    mkdir -p "$tree/DEBIAN" "$tree/etc/torqued" "$stage/pages"
    install -d "$tree"/usr/bin "$tree"/usr/lib/{systemd/system,sysusers.d,tmpfiles.d,udev/rules.d} "$tree/etc/sudoers.d"
    for program in torqued torqued-sim torquectl; do
        "$binaries/$program" --write-pages "$stage/pages"
        strip -o "$tree/usr/bin/$program" "$binaries/$program"
        chmod 755 "$tree/usr/bin/$program"
    done
    install -d "$tree/usr/share/man/man1"
    gzip -9n "$stage"/pages/man/*.1
    install -m 644 "$stage"/pages/man/*.gz "$tree/usr/share/man/man1"
    install -d "$tree"/usr/share/{bash-completion/completions,zsh/vendor-completions,fish/vendor_completions.d}
    for program in torqued torqued-sim torquectl; do
        install -m 644 "$stage/pages/completions/$program.bash" "$tree/usr/share/bash-completion/completions/$program"
    done
    install -m 644 "$stage"/pages/completions/_* "$tree/usr/share/zsh/vendor-completions"
    install -m 644 "$stage"/pages/completions/*.fish "$tree/usr/share/fish/vendor_completions.d"
    install -m 644 systemd/torqued@.service "$tree/usr/lib/systemd/system"
    install -m 644 systemd/torqued.sysusers.conf "$tree/usr/lib/sysusers.d/torqued.conf"
    install -m 644 systemd/torqued.tmpfiles.conf "$tree/usr/lib/tmpfiles.d/torqued.conf"
    install -m 644 systemd/60-torqued.rules "$tree/usr/lib/udev/rules.d"
    install -m 440 packaging/files/sudoers "$tree/etc/sudoers.d/torqued"
    local share=$tree/usr/share/torqued
    install -d "$share/examples"
    install -m 644 systemd/80-can.network "$share"
    # A configuration names its URDF and DBC files by paths that stay the same.
    for robot in config/leg config/humanoid robot-models/leg robot-models/humanoid; do
        install -d "$share/examples/$robot"
        cp -r "$robot/." "$share/examples/$robot"
    done
    chmod -R u=rwX,go=rX "$share"
    licences "$tree" torqued 'torqued torquectl'
    install -m 644 CHANGELOG.md docs/install.md docs/operating.md docs/safety.md docs/configuration.md "$tree/usr/share/doc/torqued"
    install -m 755 packaging/debian/{postinst,prerm,postrm} "$tree/DEBIAN"
    echo /etc/sudoers.d/torqued >"$tree/DEBIAN/conffiles"
    pack torqued "$tree" "$tree"/usr/bin/*
}

development() {
    local tree=$stage/torqued-dev modules=usr/lib/python3/dist-packages
    mkdir -p "$tree/DEBIAN" "$tree/$modules"
    client/c/install.sh "$tree/usr" "$binaries/libtorqued_c.so"
    # The folder in which it was made is not the one in which it is used.
    sed -i "s|$tree/usr|/usr|g" "$tree/usr/lib/pkgconfig/torqued.pc"
    strip --strip-unneeded "$tree/usr/lib/libtorqued.so.$version"
    chmod 644 "$tree/usr/lib/libtorqued.so.$version"
    cp -r client/python/torqued "$tree/$modules"
    find "$tree/$modules" -name __pycache__ -prune -exec rm -rf {} +
    install -d "$tree/usr/share/doc/torqued-dev/examples"
    cp -r client/c/examples "$tree/usr/share/doc/torqued-dev/examples/c"
    cp -r client/python/examples "$tree/usr/share/doc/torqued-dev/examples/python"
    licences "$tree" torqued-dev torqued-c
    pack torqued-dev "$tree" "$tree/usr/lib/libtorqued.so.$version"
}

wheel() {
    cp -r client/python "$stage/python"
    "$python" -m pip wheel --quiet --disable-pip-version-check --no-deps \
        --wheel-dir "$stage/wheel" "$stage/python"
    install -m 644 "$stage"/wheel/torqued-*.whl "$output"
    echo "$output"/torqued-*.whl
}

daemon
development
wheel
