#!/bin/bash
# Times our RNEA, CRBA and ABA beside Pinocchio's C++ and its generated C, on this machine.
#
#   benches/dynamics/run.sh [FOLDER]
#
# Needs clang, Python 3 with venv, and a registry of Python packages; builds everything in FOLDER
# (target/dynamics-bench), which takes some minutes the first time.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
folder=${1:-$root/target/dynamics-bench}
mkdir -p "$folder"
cd "$folder"

if [ ! -e venv/ready ]; then
    python3 -m venv venv
    venv/bin/pip install -q -r "$here/requirements.txt"
    touch venv/ready
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
flags=(-std=c++17 -O3 -march=native -DNDEBUG
    -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
    -DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12
    -isystem "$prefix/include" -isystem "$prefix/include/eigen3")
[ liblibrary.so -nt "$here/library.cpp" ] || clang++ "${flags[@]}" -shared -fPIC "$here/library.cpp" -o liblibrary.so
# The generator itself need not be fast.
[ generate -nt "$here/generate.cpp" ] || clang++ "${flags[@]}" -O0 "$here/generate.cpp" -o generate -ldl

pairs=()
for urdf in "${urdfs[@]}"; do
    name=$(basename "$urdf" .urdf)
    if [ ! -e "${name}_rnea.so" ]; then
        ./generate "$name.txt" "generated_$name"
        clang -O3 -march=native -shared -fPIC "generated_$name/rnea_forward_zero.c" -o "${name}_rnea.so" -lm
    fi
    pairs+=("$name=$urdf")
done

cargo build --release --manifest-path "$here/Cargo.toml" --target-dir "$root/target"
"$root/target/release/dynamics-bench" "$folder" "${pairs[@]}"
