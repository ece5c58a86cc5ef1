//! What needs a kernel: its tests run where `rt-tests/vm/vcan.sh` finds or lends a vcan.
//! `./test vcan` runs them.
