#!/bin/bash
# Times whole-body updates beside iDynTree's (through its Python bindings) on this machine.
#
#   benches/whole-body/run.sh [FOLDER]
#
# Needs Python 3 with venv and a registry of Python packages; builds in target/whole-body-bench.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
folder=${1:-$root/target/whole-body-bench}
mkdir -p "$folder"
if [ ! -e "$folder/venv/ready" ]; then
    python3 -m venv "$folder/venv"
    "$folder/venv/bin/pip" install -q -r "$here/requirements.txt"
    touch "$folder/venv/ready"
fi
cargo build --release --manifest-path "$here/Cargo.toml" --target-dir "$root/target"
"$folder/venv/bin/python" "$here/bench.py" "$root/target/release/whole-body-bench" "$root/robot-models/humanoid/robot.urdf"
