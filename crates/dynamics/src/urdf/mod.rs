//! URDF to [`Model`], strictly: physically unusable input is refused with file, line and reason.
//!
//! `namespaces` declares prefixes; `text` checks the XML and its numbers and hands `urdf-rs` a copy without visuals, collisions and
//! extensions (it stumbles over some of them); `unread` names what nothing reads; `tree` checks the topology; `inertia` the physics;
//! `build` makes the model; `write` gives a text other inertias. Odd but usable input ends in [`Model::warnings`].

mod build;
mod inertia;
mod namespaces;
mod text;
mod transmission;
mod tree;
mod units;
mod unread;
mod write;

pub use write::urdf_with_inertias;

use crate::model::{Base, Model};
use problem::Problem;

/// How to read a URDF.
#[derive(Clone, Debug)]
pub struct UrdfOptions {
    /// How the root link is attached to the world.
    pub base: Base,
    /// Names of mimic joints that shall be independent joints all the same.
    pub independent: Vec<String>,
}

/// A problem on a line; the file's name is added at the end.
fn problem_at(line: usize, reason: impl Into<String>, allowed: impl Into<String>) -> Problem {
    Problem::new(reason, allowed).at("", line)
}

impl Model {
    /// Reads a URDF. `file_name` is only used in messages.
    ///
    /// # Errors
    /// The first problem, with file and line.
    pub fn from_urdf(text: &str, file_name: &str, base: Base) -> Result<Model, Problem> {
        let options = UrdfOptions {
            base,
            independent: Vec::new(),
        };
        Self::from_urdf_with(text, file_name, &options)
    }

    /// Reads a URDF with options. `file_name` is only used in messages.
    ///
    /// # Errors
    /// The first problem, with file and line.
    pub fn from_urdf_with(
        text: &str,
        file_name: &str,
        options: &UrdfOptions,
    ) -> Result<Model, Problem> {
        let in_file = |problem: Problem| {
            let line = problem.line;
            problem.at(file_name, line)
        };
        let source = text::read(text).map_err(in_file)?;
        let tree = tree::Tree::new(&source, &options.independent).map_err(in_file)?;
        let mut model = build::model(&source, &tree, options.base).map_err(in_file)?;
        let unread = source.unread.into_iter();
        model.warnings = unread.chain(model.warnings).map(in_file).collect();
        Ok(model)
    }
}
