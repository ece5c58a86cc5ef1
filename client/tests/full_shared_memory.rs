//! A full `/dev/shm`: refused in words, where it would otherwise end the process by SIGBUS.

use std::process::Command;

use robot_state::{Description, Name};
use test_support::TemporaryDirectory;
use torqued_client::{DaemonPorts, Error, Location};

/// Runs in a mount namespace of its own, with a small `/dev/shm`: see below.
#[test]
#[ignore = "needs a small /dev/shm, which the other test makes"]
fn with_a_small_shared_memory() {
    let directory = TemporaryDirectory::new();
    let location = Location::at(directory.path()).expect("a run directory");
    let description = Description {
        robot: Name::new("leg"),
        ..Description::default()
    };
    let refusal = DaemonPorts::create(&location, &description).expect_err("no room");
    assert!(matches!(refusal, Error::NoRoom { .. }), "{refusal}");
    assert!(refusal.to_string().contains("/dev/shm"), "{refusal}");
}

#[test]
fn a_daemon_that_finds_no_room_in_shared_memory_does_not_start() {
    for size in ["256k", "4m", "26m"] {
        let script = format!(
            "mount -t tmpfs -o size={size} tmpfs /dev/shm || exit 77
             exec \"$0\" --ignored --exact with_a_small_shared_memory"
        );
        let out = Command::new("unshare")
            .args(["--mount", "--map-root-user", "sh", "-c", &script])
            .arg(std::env::current_exe().expect("this test"))
            .output();
        let Ok(out) = out else {
            println!("skipped: no unshare here");
            return;
        };
        let text = [out.stdout, out.stderr].concat();
        let text = String::from_utf8_lossy(&text);
        if out.status.code() == Some(77) || text.contains("unshare failed") {
            println!("skipped: no mount namespace here: {text}");
            return;
        }
        assert!(out.status.success(), "{size}: {text}");
        assert!(text.contains("1 passed"), "{size}: {text}");
    }
}
