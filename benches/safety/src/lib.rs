//! One fault in one robot at one time, in the whole loop: what the robot then truly does.
//!
//! [`Rig`] drives the daemon's cycle in front of the simulated robot, frame by frame. A
//! [`Scenario`] changes one thing from one cycle on: a frame on its way, a sensor, a drive, the
//! gear, a client, the loop's clock. [`run`] begins it in the state asked for, measures the true
//! motion of all joints for a second, and then lets an operator acknowledge and enable. The
//! program writes `docs/results/safety.md` from all of them; the tests run some of them.

mod digest;
mod learned;
mod motion;
mod page;
mod pairs;
mod rig;
mod robots;
mod run;
mod scenarios;
mod sound;

pub use digest::Digest;
pub use motion::Moved;
pub use motion::Reference;
pub use page::{Results, csv, line, page};
pub use pairs::{Pair, PairOutcome, draw, run_pair};
pub use rig::{At, Client, Fault, Rig};
pub use robots::{Drives, Prepared, Variant};
pub use run::{Outcome, Verdict, reference, run};
pub use scenarios::{Bound, Place, Scenario, Start, all, places};
pub use sound::{SoundOutcome, run_sound};
