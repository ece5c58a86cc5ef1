#!/bin/bash
# Times our RNEA, CRBA and ABA beside Pinocchio's C++ and its generated C, on this machine.
#
#   benches/dynamics/run.sh [FOLDER]
#
# Installs what it needs (Debian packages as root or by sudo, Python packages in FOLDER) and builds
# everything in FOLDER (target/dynamics-bench): ten minutes the first time.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
folder=$(realpath -m "${1:-$root/target/dynamics-bench}")
mkdir -p "$folder"

step() { echo "bench: $*" >&2; }

"$root/rt-tests/install.sh" --bench
cd "$folder"
if ! cmp -s "$here/requirements.txt" venv/requirements.txt; then
    step "Pinocchio, CppAD and CppADCodeGen"
    python3 -m venv --clear venv
    venv/bin/pip install --disable-pip-version-check -q -r "$here/requirements.txt"
    cp "$here/requirements.txt" venv/ # last: marks that all of it is there
fi
prefix=$(venv/bin/python -c 'import pinocchio; from pathlib import Path; print(Path(pinocchio.__file__).resolve().parents[4])')
robots=$prefix/share/example-robot-data/robots
urdfs=(
    "$robots/solo_description/robots/solo12.urdf"
    "$robots/simple_humanoid_description/urdf/simple_humanoid.urdf"
    "$robots/talos_data/robots/talos_full_v2.urdf"
)
venv/bin/python "$here/models.py" . "${urdfs[@]}"

# CppAD's base types lack two members that Pinocchio uses of any scalar.
venv/bin/python "$here/complete_cppad.py" "$prefix/include/cppad/cg"

# Boost's preprocessed headers allow 20 joint types; Pinocchio has more.
headers=(-std=c++17 -DNDEBUG
    -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
    -DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12
    -isystem "$prefix/include" -isystem "$prefix/include/eigen3")
# The last two make generated code a fifth faster: it calls sine and cosine together, and fuses.
fast=(-O3 -march=native -ffp-contract=fast -fno-math-errno)
if ! [ liblibrary.so -nt "$here/library.cpp" ]; then
    step "Pinocchio's algorithms, C++, ${fast[*]}"
    clang++ "${headers[@]}" "${fast[@]}" -shared -fPIC "$here/library.cpp" -o liblibrary.so
fi
if ! [ generate -nt "$here/generate.cpp" ]; then
    step "the generator"
    clang++ "${headers[@]}" -O0 "$here/generate.cpp" -o generate -ldl
fi

pairs=()
for urdf in "${urdfs[@]}"; do
    name=$(basename "$urdf" .urdf)
    if [ ! -e "${name}_rnea.so" ]; then
        step "generated RNEA of $name, C, ${fast[*]}"
        ./generate "$name.txt" "generated_$name"
        clang "${fast[@]}" -shared -fPIC "generated_$name/rnea_forward_zero.c" -o "${name}_rnea.so" -lm
    fi
    pairs+=("$name=$urdf")
done

step "ours, as the workspace's release profile builds it"
cargo build --release --locked --manifest-path "$root/Cargo.toml" -p dynamics-bench --target-dir "$folder/cargo"
grep -m1 '^model name' /proc/cpuinfo | cut -d: -f2- | sed 's/^ *//'
clang --version | head -1
rustc --version
"$folder/cargo/release/dynamics-bench" "$folder" "${pairs[@]}"
