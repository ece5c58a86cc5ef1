//! All tests of `estimators` in one program, which is built and linked once.

mod compliance;
mod current_based;
mod encoder;
mod fusion;
mod hysteresis;
mod kalman;
mod local_gp;
mod matched_filter;
mod radius;
mod savitzky_golay;
