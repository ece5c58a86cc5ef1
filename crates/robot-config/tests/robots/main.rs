//! Configurations of whole robots: those of the repository, and faulty ones.

mod accepted;
mod files;
mod refusals;
