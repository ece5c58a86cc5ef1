//! Joint torques of a robot that `torqued` runs, and references for it, by shared memory.
//!
//! A program that only reads:
//! ```no_run
//! # fn main() -> Result<(), torqued_client::Error> {
//! let mut client = torqued_client::Client::connect("leg")?;
//! let names = client.description().joint_names;
//! let record = client.next_record(std::time::Duration::from_secs(1))?;
//! println!("{}: {:.2} N·m", names[0], record.cycle.estimated.joints[0].tau_whole_body.tau);
//! # Ok(())
//! # }
//! ```
//! A program that commands adds a [`Commander`]; there is one at a time per robot. Any program may
//! send requests: [`Client::tare`], [`Client::choose_contact_set`].
//!
//! The daemon's end ([`DaemonPorts`]) lives here too, so that both ends are defined side by side.
//! Every wait has a time limit, and every error names its remedy. Only processes of
//! the daemon's own user can connect.

mod c_layout;
mod channel;
mod client;
mod commander;
mod daemon_ports;
mod discovery;
mod enumerations;
mod error;
mod follow;
mod location;
mod names;
mod node_counter;
mod process_file;
mod python_layout;
mod requests;
mod room;
mod state_directory;
mod timing_file;

pub use c_layout::c_layout;
pub use client::{Client, Record};
pub use commander::Commander;
pub use commander::keep::{KeptCommander, LONGEST_BUSY, Meanwhile, run_before_ordinary_programs};
pub use daemon_ports::DaemonPorts;
pub use error::{Error, why_not_followed, why_piece_refused, why_refused};
pub use follow::{Progress, Timing};
pub use location::Location;
pub use process_file::{ProcessFile, RunningDaemon, running_daemons};
pub use python_layout::python_layout;
pub use robot_state;
pub use state_directory::StateDirectory;
pub use timing_file::TimingFile;
