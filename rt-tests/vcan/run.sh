#!/bin/bash
# Runs where the vcan is: the Rust tests given as arguments, then the whole-process tests.
set -u
code=0
for binary in "$@"; do
    (cd rt-tests && "$binary") || code=1
done
.venv/bin/pytest rt-tests/vcan || code=1
exit $code
