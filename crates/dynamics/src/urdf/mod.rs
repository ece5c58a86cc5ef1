//! URDF to [`Model`], strictly: what is physically unusable is refused with file, line and reason.
//!
//! `text` checks the XML and its numbers and hands `urdf-rs` a copy without visuals, collisions and
//! extensions (it stumbles over some of them); `tree` checks the topology; `inertia` the physics;
//! `build` makes the model. Odd but usable input ends in [`Model::warnings`].

mod build;
mod inertia;
mod text;
mod transmission;
mod tree;

use crate::model::{Base, Model};

/// Why a URDF was refused: `file:line: reason; allowed: ...`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UrdfError {
    /// Name of the file, as given.
    pub file: String,
    /// Line, from 1.
    pub line: u32,
    /// What is wrong and what is allowed.
    pub reason: String,
}

impl std::fmt::Display for UrdfError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.reason)
    }
}

impl std::error::Error for UrdfError {}

/// How to read a URDF.
#[derive(Clone, Debug)]
pub struct UrdfOptions {
    /// How the root link is attached to the world.
    pub base: Base,
    /// Names of mimic joints that shall be independent joints all the same.
    pub independent: Vec<String>,
}

/// A complaint before it knows its file.
pub(crate) type Complaint = (u32, String);

impl Model {
    /// Reads a URDF. `file_name` is only used in messages.
    pub fn from_urdf(text: &str, file_name: &str, base: Base) -> Result<Model, UrdfError> {
        let options = UrdfOptions {
            base,
            independent: Vec::new(),
        };
        Self::from_urdf_with(text, file_name, &options)
    }

    /// Reads a URDF with options. `file_name` is only used in messages.
    pub fn from_urdf_with(
        text: &str,
        file_name: &str,
        options: &UrdfOptions,
    ) -> Result<Model, UrdfError> {
        let refuse = |(line, reason): Complaint| UrdfError {
            file: file_name.to_owned(),
            line,
            reason,
        };
        let source = text::read(text).map_err(refuse)?;
        let tree = tree::Tree::new(&source, &options.independent).map_err(refuse)?;
        let mut model = build::model(&source, &tree, options.base).map_err(refuse)?;
        for warning in &mut model.warnings {
            warning.insert_str(0, &format!("{file_name}:"));
        }
        Ok(model)
    }
}
