#!/bin/bash
# Installs libtorqued, its headers, and what pkg-config and CMake need to find them.
set -eu
here=$(cd "$(dirname "$0")" && pwd)

usage() {
    cat <<END
usage: client/c/install.sh PREFIX [LIBRARY]

Installs into PREFIX, e.g. /usr/local: lib/libtorqued.so, include/torqued, lib/pkgconfig/torqued.pc
and lib/cmake/torqued. LIBRARY: a libtorqued_c.so that is built already; without it, this builds one
with cargo.
END
}

case ${1-} in
    -h | --help) usage; exit 0 ;;
    '' | -*) usage >&2; exit 2 ;;
esac
mkdir -p "$1"
prefix=$(cd "$1" && pwd)
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -n 1)
library=${2-}
if [ -z "$library" ]; then
    cargo build --release --manifest-path "$here/Cargo.toml"
    library=${CARGO_TARGET_DIR:-$here/../../target}/release/libtorqued_c.so
fi

install -d "$prefix"/lib/{pkgconfig,cmake/torqued} "$prefix/include/torqued"
install -m 644 "$here"/include/torqued/* "$prefix/include/torqued"
install -m 755 "$library" "$prefix/lib/libtorqued.so.$version"
ln -sf "libtorqued.so.$version" "$prefix/lib/libtorqued.so.0"
ln -sf libtorqued.so.0 "$prefix/lib/libtorqued.so"
fill() { sed -e "s|@PREFIX@|$prefix|" -e "s|@VERSION@|$version|" "$here/package/$1"; }
fill torqued.pc.in >"$prefix/lib/pkgconfig/torqued.pc"
fill torqued-config-version.cmake.in >"$prefix/lib/cmake/torqued/torqued-config-version.cmake"
install -m 644 "$here/package/torqued-config.cmake" "$prefix/lib/cmake/torqued"
