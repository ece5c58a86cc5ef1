//! Puts the project's robots into the program: a table of the files of `config` and `robot-models` that the demo
//! reads, with what calibrations left beside them.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// The demo's robots.
const NAMES: [&str; 5] = ["test-joint", "leg", "hrp2-like", "lift-gripper", "humanoid"];

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default()).join("..");
    let mut files = Vec::new();
    for folder in ["config", "robot-models"] {
        for name in NAMES {
            let folder = format!("{folder}/{name}");
            println!("cargo::rerun-if-changed=../{folder}");
            collect(&root, &folder, &mut files)?;
        }
    }
    files.sort();
    let mut table = format!(
        "/// Names of the demo's robots.\npub(super) const NAMES: &[&str] = &{NAMES:?};\n\
         /// Every file of the demo's robots, by its path in the project.\nconst FILES: &[(&str, &str)] = &[\n"
    );
    for path in &files {
        let place = root.join(path);
        let _ = writeln!(table, "    ({path:?}, include_str!({place:?})),");
    }
    table.push_str("];\n");
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::write(out.join("robots.rs"), table)
}

/// Adds the paths from `root` of a folder's files that a robot is described by.
fn collect(root: &Path, folder: &str, files: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(root.join(folder))? {
        let entry = entry?;
        let path = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            collect(root, &path, files)?;
        } else if [".toml", ".urdf", ".dbc"]
            .iter()
            .any(|end| path.ends_with(end))
        {
            files.push(path);
        }
    }
    Ok(())
}
