//! Tests that need a kernel: they run where `rt-tests/vm/vcan.sh` finds or lends a vcan.
//! `./test vcan` runs them.
