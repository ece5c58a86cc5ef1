//! Records of the pipeline and of shared memory: measured, estimated, commanded; references and
//! requests; events.
//!
//! Every record is `#[repr(C)]`, has a fixed size, holds SI units, and describes its own layout
//! ([`Layout`]), so that mirrors in other languages are generated and never written by hand.
//! First words of a field's documentation: printed symbol, meaning, unit.
#![deny(unsafe_code)]

mod content;
mod event;
mod joint_kind;
mod layout;
mod name;
mod records;
mod requests;
mod state;

pub use content::Content;
pub use event::{EVENT_COUNT, Event, Reaction, Reactions, source};
pub use joint_kind::JointKind;
pub use layout::{Field, Layout, Shape, layout_hash};
pub use name::{Name, Text};
pub use records::*;
pub use requests::*;
pub use state::{DriveState, RobotState};
