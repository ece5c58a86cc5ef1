//! Bad `sim.toml` files are refused with file, line, key and the allowed values.

use crate::common::{can_robot, parameters};
use plant::SimParameters;

const GOOD: &str = "substep_us = 100.0\n[start]\njoints_deg = { knee = 10.0 }\n";

fn error(text: &str) -> String {
    let error = SimParameters::parse(text, "sim.toml").unwrap_err();
    error.to_string()
}

#[test]
fn good_text_is_read_in_si_units() {
    let sim = SimParameters::parse(GOOD, "sim.toml").unwrap();
    assert!((sim.substep - 1e-4).abs() < 1e-18);
    assert!((sim.start.joints["knee"] - 10.0_f64.to_radians()).abs() < 1e-15);
}

#[test]
fn unknown_keys_are_named_with_their_line() {
    let e = error(&format!("{GOOD}[imu]\ngyro_nois = 1.0\n"));
    assert!(e.starts_with("sim.toml:5: gyro_nois:"), "{e}");
    assert!(e.contains("gyro_noise_rad_per_s"), "{e}");
}

#[test]
fn values_out_of_range_are_refused_with_the_range() {
    for (text, line, key) in [
        ("substep_us = -1.0\n", 1, "substep_us"),
        ("substep_us = nan\n", 1, "substep_us"),
        (
            "substep_us = 100.0\ninertia_error_per_cent = 80.0\n",
            2,
            "inertia_error_per_cent",
        ),
        (
            "substep_us = 100.0\n[imu]\ngyro_noise_rad_per_s = -0.1\n",
            3,
            "gyro_noise_rad_per_s",
        ),
    ] {
        let e = error(text);
        assert!(e.starts_with(&format!("sim.toml:{line}: {key}:")), "{e}");
        assert!(e.contains("allowed"), "{e}");
    }
    assert!(error("substep_us = 5000.0\n").contains("substep_us"));
}

#[test]
fn missing_keys_are_named() {
    let e = error("seed = 1\n");
    assert!(e.contains("substep_us"), "{e}");
    let e = error("substep_us = 100.0\n[start]\non_ground = true\n");
    assert!(
        e.contains("start.on_ground") && e.contains("[[foot]]"),
        "{e}"
    );

    let mut sim = parameters("leg");
    sim.drives.remove("knee");
    let e = can_robot("leg", &sim).unwrap_err().to_string();
    assert!(e.contains("drive.knee") && e.contains("ankle_roll"), "{e}");

    let mut sim = parameters("leg");
    sim.start.joints.insert("elbow".into(), 0.1);
    let e = can_robot("leg", &sim).unwrap_err().to_string();
    assert!(e.contains("start.joints_deg.elbow"), "{e}");
}
