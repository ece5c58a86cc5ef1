//! Configurations of whole robots: those of the repository, and faulty ones.

mod accepted;
mod buses;
mod drives;
mod files;
mod meant;
mod motor_alone;
mod nodes;
mod prismatic;
mod refusals;
