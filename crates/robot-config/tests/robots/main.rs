//! Configurations of whole robots: those of the repository, and spoilt ones.

mod accepted;
mod files;
mod refusals;
