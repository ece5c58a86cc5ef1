//! Writes a page of results from standard input, and the CSV files of its marked tables beside it:
//! `cargo run --release -p cycle --example motor_alone | cargo run -p test-support --example results_page
//! docs/results/motor-alone.md`

use std::io::Read as _;
use std::path::Path;
use test_support::ResultsPage;

fn main() -> Result<(), String> {
    let path = std::env::args()
        .nth(1)
        .ok_or("which page is to be written?")?;
    let mut marked = String::new();
    let mut input = std::io::stdin();
    input
        .read_to_string(&mut marked)
        .map_err(|e| e.to_string())?;
    ResultsPage::new(&marked)?.write(Path::new(&path))
}
