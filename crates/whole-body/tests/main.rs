//! All tests of `whole-body` in one program, which is built and linked once.

mod common;
mod delay_compensation;
mod momentum;
mod random_robots;
mod refusals;
mod sigma;
mod tare;
mod walk;
mod walking;
