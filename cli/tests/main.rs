//! All tests of `cli` in one program, which is built and linked once.

mod blackbox;
mod check;
mod common;
mod config;
mod doctor;
mod doctor_machine;
mod dynamics;
mod excite;
mod formats;
mod identify;
mod import;
mod joint_torque;
mod learn;
mod old_files;
mod reference;
mod requests;
mod shipped;
mod watch;
