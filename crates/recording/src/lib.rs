//! A recorded run: the schemas and the layout of its file, and what replay reads of it.
//!
//! In: what every call of [`cycle::Cycle::step`] takes and gives. Out: an MCAP file
//! (<https://mcap.dev>), a message for each cycle, with the robot's configuration files attached, so
//! that the run can be computed again from the file alone. The same messages stand in the daemon's
//! memory for the last seconds; a black box is a part of that memory, written as such a file.
//!
//! Beside our own messages the file carries JointState, WrenchStamped and Imu of ROS 2, which other
//! people's tools draw.
#![deny(unsafe_code)]

mod cdr;
mod check;
mod coder;
mod compact;
mod fields;
mod frames;
mod header;
mod message;
mod reader;
mod replay;
mod ros;
mod schema;
mod signals;
mod timeline;
mod torques;
mod writer;

pub use compact::Counts;
pub use fields::{Field, Fields, Kind};
pub use header::{AttachedFile, Header, Start};
pub use message::{CycleInput, CycleMessage, Decoder, Encoder, Glance, Note};
pub use reader::{Ending, ReadError, Run};
pub use replay::{Difference, Replay, Replayed, TORQUES, TorqueDifference};
pub use ros::{RosChannel, RosMessages};
pub use signals::{READ_SCHEMAS, Signal, SignalCollector, Signals, read_signals};
pub use timeline::{Happening, Span, Timeline, cause_of};
pub use torques::is_in_torques;
pub use writer::{RunWriter, WriteError};
