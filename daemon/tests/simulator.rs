//! `torqued-sim` where no CAN is needed: what it refuses.

use std::process::Command;

#[test]
fn sensors_that_keep_their_own_time_are_refused_on_can() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let sim = std::fs::read_to_string(format!("{root}/config/leg/sim.toml")).expect("sim.toml");
    let path = std::env::temp_dir().join(format!("torqued-sim-{}.toml", std::process::id()));
    let own = "[ft_sensor.sampling]\nsampled = \"when_sent\"\n";
    std::fs::write(&path, format!("{sim}\n{own}")).expect("written");
    let out = Command::new(env!("CARGO_BIN_EXE_torqued-sim"))
        .arg(format!("{root}/config/leg/robot.toml"))
        .arg("--sim")
        .arg(&path)
        .output()
        .expect("runs");
    std::fs::remove_file(&path).expect("removed");
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(
        said.contains("ft_sensor.sampling.sampled: on a CAN bus"),
        "{said}"
    );
    assert!(said.contains("allowed: \"at_sync\""), "{said}");
}
