//! Files that a command cannot write to their end (a full disk), or would make from themselves: each is named, and the
//! older file of that name stays whole.

use crate::common;

use common::{expect, record_demo};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use test_support::project_path;

const OLD: &str = "what was there before\n";

fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("old-files-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string();
    let mut names: Vec<String> = entries.map(|entry| name(entry).unwrap()).collect();
    names.sort();
    names
}

/// Runs `torquectl` where a file can grow to 1 KiB; it must refuse, and name the file.
fn on_a_full_disk(folder: &Path, arguments: &str, file: &str) {
    let output = Command::new("bash")
        .args(["-c", "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\""])
        .arg(env!("CARGO_BIN_EXE_torquectl"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap();
    let shown = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments}\n{shown}");
    let named = format!("{file}: cannot be written");
    assert!(shown.contains(&named), "{arguments}\n{shown}");
}

/// A recording of the test joint of 2 s, a log of it and its map.
fn inputs(folder: &Path) {
    let motion =
        "settle_s = 0.2\njoint = [{ name = \"joint\", amplitude_deg = 20, period_s = 2 }]\n";
    fs::write(folder.join("motion.toml"), motion).unwrap();
    let robot = project_path("config/test-joint/robot.toml");
    record_demo(folder, robot, 2.0, 1);
    let map = "sample_rate_hz = 1000\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[[joint]]\nname = \"joint\"\n\
        gear_ratio = 100\ntheta = { column = \"m\", unit = \"rad\" }\nq = { column = \"l\", unit = \"rad\" }\n\
        i = { column = \"i\", unit = \"A\" }\n";
    fs::write(folder.join("map.toml"), map).unwrap();
    let row = |k: i32| {
        let t = f64::from(k) * 1e-3;
        format!("{t},{},{},{}\n", 100.0 * t.sin(), t.sin(), t.cos())
    };
    let log: String = (0..400).map(row).collect();
    fs::write(folder.join("log.csv"), format!("t,m,l,i\n{log}")).unwrap();
}

#[test]
fn a_full_disk_leaves_what_was_there() {
    let folder = folder("full");
    inputs(&folder);
    for (arguments, file) in [
        ("export run.mcap -o old.csv", "old.csv"),
        ("replay run.mcap --report old.html", "old.html"),
        ("import map.toml log.csv -o sub", "sub/log.csv"),
    ] {
        let path = folder.join(file);
        let place = path.parent().unwrap();
        fs::create_dir_all(place).unwrap();
        fs::write(&path, OLD).unwrap();
        let before = names(place);
        on_a_full_disk(&folder, arguments, file);
        let after = fs::read_to_string(&path).unwrap();
        assert_eq!(after, OLD, "{arguments}");
        assert_eq!(names(place), before, "{arguments}: nothing half-written");
    }
    // With room the same commands replace it.
    expect(&folder, "export run.mcap -o old.csv", 0);
    assert!(
        fs::read_to_string(folder.join("old.csv"))
            .unwrap()
            .lines()
            .count()
            > 1900
    );
}

#[test]
fn a_command_does_not_write_over_what_it_reads() {
    let folder = folder("itself");
    inputs(&folder);
    fs::create_dir(folder.join("sub")).unwrap();
    let before = ["run.mcap", "log.csv"].map(|file| fs::read(folder.join(file)).unwrap());
    for arguments in [
        "export run.mcap -o run.mcap",
        "export run.mcap -o sub/../run.mcap",
        "replay run.mcap --report run.mcap",
        "blackbox run.mcap --csv run.mcap",
        "import map.toml log.csv -o .",
        "estimate --joint map.toml --log log.csv --out log.csv",
        "estimate --joint map.toml --log log.csv --report map.toml",
    ] {
        let shown = expect(&folder, arguments, 2);
        assert!(shown.contains("is what is read"), "{arguments}\n{shown}");
    }
    let after = ["run.mcap", "log.csv"].map(|file| fs::read(folder.join(file)).unwrap());
    assert_eq!(before, after);
}
