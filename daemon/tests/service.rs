//! The systemd unit, as systemd itself judges it.

use std::process::Command;

use test_support::{TemporaryDirectory, project_path};

/// `systemd-analyze`'s answer and its exit code; none where there is no systemd.
fn systemd_analyze(arguments: &[&str]) -> Option<(bool, String)> {
    let Ok(out) = Command::new("systemd-analyze").args(arguments).output() else {
        println!("skipped: no systemd-analyze here (Debian: package systemd)");
        return None;
    };
    let text = [out.stdout, out.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    Some((out.status.success(), text))
}

/// The unit as instance `leg`, with the program that was just built.
fn unit(directory: &TemporaryDirectory) -> String {
    let text = std::fs::read_to_string(project_path("systemd/torqued@.service")).expect("a unit");
    assert!(text.contains("/usr/bin/torqued "));
    let text = text.replace("/usr/bin/torqued", env!("CARGO_BIN_EXE_torqued"));
    std::fs::create_dir_all(directory.path()).expect("made");
    let path = directory.path().join("torqued@leg.service");
    std::fs::write(&path, text).expect("written");
    path.display().to_string()
}

#[test]
fn the_unit_has_no_key_that_systemd_does_not_know() {
    let directory = TemporaryDirectory::new();
    let unit = unit(&directory);
    let verify = ["verify", "--man=no", "--recursive-errors=no", &unit];
    if let Some((good, answer)) = systemd_analyze(&verify) {
        assert!(good && answer.trim().is_empty(), "{answer}");
    }
}

#[test]
fn the_unit_gives_away_no_more_than_it_needs() {
    let directory = TemporaryDirectory::new();
    let unit = unit(&directory);
    // 100 times the exposure level; without hardening it is 970.
    let security = [
        "security",
        "--offline=true",
        "--threshold=35",
        "--no-pager",
        &unit,
    ];
    if let Some((good, answer)) = systemd_analyze(&security) {
        assert!(good, "{answer}");
    }
}
