//! Shared by the tests of all rooms, and by nothing else: a count of allocations, random numbers
//! that a seed repeats, the project's own files, temporary directories. Benches write their pages with it.
//!
//! Uses no other crate, so that every crate's tests may use it.

mod allocation;
mod nodes;
mod page_section;
mod project;
mod random;
mod results_page;
mod temporary_directory;

pub use allocation::allocations;
pub use nodes::with_canopen_nodes;
pub use page_section::{section, with_section};
pub use project::{judged_motion, project_path, read_project_file, read_with_drives_always_on};
pub use random::Random;
pub use results_page::ResultsPage;
pub use temporary_directory::TemporaryDirectory;
