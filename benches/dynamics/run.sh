#!/bin/bash
# Times our RNEA, CRBA and ABA beside Pinocchio's C++ and its generated C, on this machine, and writes
# docs/results/dynamics.md.
#
#   benches/dynamics/run.sh [FOLDER]
#
# Installs what it needs (Debian packages as root or by sudo, Python packages in FOLDER) and builds
# everything in FOLDER (target/dynamics-bench): ten minutes the first time. models.py and pinocchio_model.hpp make robots
# of URDFs as text, library.cpp has Pinocchio behind a C interface, generate.cpp and complete_cppad.py make code by
# CppADCodeGen, whose headers lack two members.
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
urdfs=$prefix/share/example-robot-data/robots
# NAME=BASE=URDF: chains, then branching robots.
robots=(
    "double_pendulum=fixed=$urdfs/double_pendulum_description/urdf/double_pendulum.urdf"
    "leg=fixed=$root/robot-models/leg/robot.urdf"
    "leg_floating=floating=$root/robot-models/leg/robot.urdf"
    "ur5=fixed=$urdfs/ur_description/urdf/ur5_robot.urdf"
    "z1=fixed=$urdfs/z1_description/urdf/z1.urdf"
    "panda=fixed=$urdfs/panda_description/urdf/panda.urdf"
    "b1_z1=floating=$urdfs/b1_description/urdf/b1-z1.urdf"
    "solo12=floating=$urdfs/solo_description/robots/solo12.urdf"
    "baxter=fixed=$urdfs/baxter_description/urdf/baxter.urdf"
    "g1=floating=$urdfs/g1_description/urdf/g1_29dof_rev_1_0.urdf"
    "simple_humanoid=floating=$urdfs/simple_humanoid_description/urdf/simple_humanoid.urdf"
    "icub=floating=$urdfs/icub_description/robots/icub.urdf"
    "talos_full_v2=floating=$urdfs/talos_data/robots/talos_full_v2.urdf"
)
venv/bin/python "$here/models.py" . "${robots[@]}"

# CppAD's base types lack two members that Pinocchio uses of any scalar.
venv/bin/python "$here/complete_cppad.py" "$prefix/include/cppad/cg"

# Boost's preprocessed headers allow 20 joint types; Pinocchio has more.
headers=(-std=c++17 -DNDEBUG
    -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
    -DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12
    -isystem "$prefix/include" -isystem "$prefix/include/eigen3")
# The last two make generated code a fifth faster: it calls sine and cosine together, and fuses.
fast=(-O3 -march=native -ffp-contract=fast -fno-math-errno)
newer() { [ "$1" -nt "$2" ] && [ "$1" -nt "$here/pinocchio_model.hpp" ]; }
if ! newer liblibrary.so "$here/library.cpp"; then
    step "Pinocchio's algorithms, C++, ${fast[*]}"
    clang++ "${headers[@]}" "${fast[@]}" -shared -fPIC "$here/library.cpp" -o liblibrary.so
fi
if ! newer generate "$here/generate.cpp"; then
    step "the generator"
    clang++ "${headers[@]}" -O0 "$here/generate.cpp" -o generate -ldl
fi

for robot in "${robots[@]}"; do
    name=${robot%%=*}
    code=generated_$name/rnea_forward_zero.c
    if ! [ "$code" -nt generate ]; then
        step "generated RNEA of $name, C"
        ./generate "$name.txt" "generated_$name"
    fi
    # The faster of two compilers counts; the second is of the age of rustc's LLVM, with sines and
    # cosines of the C library's vector kind.
    if ! [ "${name}_rnea_clang.so" -nt "$code" ]; then
        clang "${fast[@]}" -shared -fPIC "$code" -o "${name}_rnea_clang.so" -lm
    fi
    if ! [ "${name}_rnea_clang19.so" -nt "$code" ]; then
        clang-19 "${fast[@]}" -fveclib=libmvec -fno-trapping-math -shared -fPIC "$code" \
            -o "${name}_rnea_clang19.so" -lmvec -lm
    fi
done

step "ours, as the workspace's release profile builds it"
cargo build --release --locked --manifest-path "$root/Cargo.toml" -p dynamics-bench --target-dir "$folder/cargo"
{
    cat "$here/src/page.md"
    echo
    echo "$(grep -m1 '^model name' /proc/cpuinfo | cut -d: -f2- | sed 's/^ *//'), $(clang --version | head -1)," \
        "$(clang-19 --version | head -1), $(rustc --version | cut -d' ' -f1,2), $(date '+%-d %B %Y'): medians, ns."
    echo
    echo '<!-- rows: dynamics.csv, 5 greatest of ours / library -->'
    echo
    echo '| robot | nv | algorithm | ours | library | generated | ours / library | ours / generated |'
    echo '| --- | --- | --- | --- | --- | --- | --- | --- |'
    "$folder/cargo/release/dynamics-bench" "$folder" "${robots[@]}"
} >"$folder/page.md"
cargo run -q --release --locked --manifest-path "$root/Cargo.toml" -p test-support --example results_page \
    --target-dir "$folder/cargo" "$root/docs/results/dynamics.md" <"$folder/page.md"
