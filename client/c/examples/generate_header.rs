//! Prints `client/c/include/torqued/torqued.h`:
//!
//!     cargo run -p torqued-c --example generate_header > client/c/include/torqued/torqued.h

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = env!("CARGO_MANIFEST_DIR");
    let config = cbindgen::Config::from_file(format!("{folder}/cbindgen.toml"))?;
    cbindgen::generate_with_config(folder, config)?.write(std::io::stdout());
    Ok(())
}
