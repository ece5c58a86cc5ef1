//! `torquectl fit` and `torquectl estimate` as whole processes: a joint made by formulas, and every kind of bad log.

mod refusals;

use serde_json::Value;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Instant;

const JOINT: &str = "\
[joint]
name = \"made\"
gear_ratio = 100.0
torque_constant_Nm_per_A = 0.05
rotor_inertia_kg_m2 = 1e-5
rated_torque_Nm = 16.0
link_counts_per_turn = 524288
motor_counts_per_turn = 65536
sample_rate_hz = 1000.0
";

/// A linear gear of 8000 N·m/rad with one harmonic of error, read without noise.
fn log(seconds: f64, q: impl Fn(f64) -> f64, tau: impl Fn(f64) -> f64) -> String {
    let mut text = "t,theta,q,i,tau_sensor\n".to_owned();
    for k in 0..(seconds * 1e3) as i32 {
        let t = 1e-3 * f64::from(k);
        let (angle, load) = (q(t), tau(t));
        let theta = 100.0 * (angle + load / 8000.0 + 5e-5 * angle.sin());
        let count = std::f64::consts::TAU / 65536.0;
        let theta = (theta / count).round() * count;
        let dq = (q(t + 1e-4) - q(t - 1e-4)) / 2e-4;
        let current = (load + (dq / 0.01).tanh()) / 5.0;
        writeln!(text, "{t},{theta},{angle},{current},{load}").unwrap();
    }
    text
}

fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("joint-torque-{test}"));
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("joint.toml"), JOINT).unwrap();
    folder
}

fn torquectl(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(arguments.split(' '))
        .current_dir(folder)
        .output()
        .unwrap()
}

fn succeeds(folder: &Path, arguments: &str) -> String {
    let output = torquectl(folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn fit_all_then_estimate() {
    let folder = folder("all");
    let turn = |t: f64| 3.3 * (0.45 * t - 1.5).sin();
    fs::write(folder.join("turn.csv"), log(14.0, turn, |_| 0.0)).unwrap();
    let q = |t: f64| (1.1 * t).sin() * ((t - 6.0) / 3.0).clamp(0.0, 1.0);
    let tau = |t: f64| 7.0 * (2.1 * t).sin() + 3.0 * (0.7 * t).cos();
    fs::write(folder.join("train.csv"), log(20.0, q, tau)).unwrap();
    fs::write(
        folder.join("run.csv"),
        log(5.0, |t| q(t + 9.0), |t| 8.0 * (3.0 * t).sin()),
    )
    .unwrap();
    let report = succeeds(
        &folder,
        "fit all --joint joint.toml --no-load turn.csv --training train.csv -o fitted.toml --report fit.html",
    );
    for step in [
        "kinematic error",
        "skew",
        "compliance",
        "network",
        "written: fitted.toml",
    ] {
        assert!(report.contains(step), "{report}");
    }
    let json = succeeds(
        &folder,
        "estimate --joint fitted.toml --log run.csv --json --out out.csv --report run.html",
    );
    for (page, contains) in [
        ("fit.html", "compliance: K_fs0"),
        ("run.html", "condition number"),
    ] {
        let html = fs::read_to_string(folder.join(page)).unwrap();
        // A picture of the torque, and one for each source; nothing from anywhere else.
        let sources = html.matches("<h2>").count();
        assert!(
            html.matches("<svg").count() >= 8 && sources >= 9,
            "{page}: {sources}"
        );
        assert!(
            html.contains(contains) && html.contains("RMS of error / sigma"),
            "{page}"
        );
        let links = ["href", "src=", "@import", "<script"];
        assert!(links.iter().all(|link| !html.contains(link)), "{page}");
        assert!(
            html.ends_with("</body></html>\n") && !html.contains("NaN"),
            "{page}"
        );
        assert!(html.len() < 6_000_000, "{page}: {}", html.len());
    }
    let figures: Value = serde_json::from_str(&json).unwrap();
    for key in ["max", "rms", "rms_percent", "delay_s"] {
        assert!(figures["fused"][key].is_number(), "{json}");
    }
    assert!(
        figures["fused"]["rms_percent"].as_f64().unwrap() < 1.0,
        "{json}"
    );
    let out = fs::read_to_string(folder.join("out.csv")).unwrap();
    assert_eq!(out.lines().count(), 5001);
    assert!(
        out.starts_with("t,tau_sensor,tau_compliance,sigma_compliance"),
        "{}",
        &out[..80]
    );

    estimate_inspects(&folder);
    // One step alone, on what is there; the fusion that depends on it is made anew.
    let report = succeeds(
        &folder,
        "fit compliance --joint fitted.toml --log train.csv -o again.toml",
    );
    assert!(report.contains("compliance: K_fs0"), "{report}");
    let table = succeeds(&folder, "estimate --joint again.toml --log run.csv");
    assert!(
        table.contains("correlation") && table.contains("fused"),
        "{table}"
    );
}

/// `run.csv` of the folder with theta, q and tau_sensor of each row changed.
fn varied(folder: &Path, change: impl Fn(&mut [f64; 3])) {
    let run = fs::read_to_string(folder.join("run.csv")).unwrap();
    let mut lines = run.lines();
    let mut text = lines.next().unwrap().to_owned() + "\n";
    for line in lines {
        let cells: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let mut changed = [cells[1], cells[2], cells[4]];
        change(&mut changed);
        let [theta, q, tau] = changed;
        writeln!(text, "{},{theta},{q},{},{tau}", cells[0], cells[3]).unwrap();
    }
    fs::write(folder.join("varied.csv"), text).unwrap();
}

/// What is wrong with a log is named, or mended and said.
fn estimate_inspects(folder: &Path) {
    const ESTIMATE: &str = "estimate --joint fitted.toml --log varied.csv --json";
    type Change = fn(&mut [f64; 3]);
    let refused: [(Change, &str); 5] = [
        (
            |[theta, ..]| *theta = theta.to_degrees(),
            "`theta` is in degrees",
        ),
        (|[theta, ..]| *theta = -*theta, "reversed"),
        (|[theta, q, _]| (*theta, *q) = (-*theta, -*q), "reversed"),
        (|[theta, q, _]| std::mem::swap(theta, q), "swapped"),
        (|[_, _, tau]| *tau *= 1.7, "times its own sigma"),
    ];
    for (change, expected) in refused {
        varied(folder, change);
        let output = torquectl(folder, ESTIMATE);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{expected}: {errors}");
        assert!(errors.contains(expected), "{expected}: {errors}");
        succeeds(folder, &format!("{ESTIMATE} --accept"));
    }
    let run = fs::read_to_string(folder.join("run.csv")).unwrap();
    let milli = run.lines().map(|line| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if let Ok(current) = cells[3].parse::<f64>() {
            cells[3] = (1e3 * current).to_string();
        }
        cells.join(",") + "\n"
    });
    fs::write(folder.join("varied.csv"), milli.collect::<String>()).unwrap();
    let errors = torquectl(folder, ESTIMATE).stderr;
    let errors = String::from_utf8_lossy(&errors);
    assert!(errors.contains("is `i` in mA?"), "{errors}");
    let mended: [(Change, &str); 2] = [
        (|[theta, ..]| *theta -= 3.0 * TAU, "`theta` is -3 turns off"),
        (
            |[theta, ..]| *theta = theta.rem_euclid(TAU),
            "`theta` wraps",
        ),
    ];
    for (change, expected) in mended {
        varied(folder, change);
        let output = torquectl(folder, ESTIMATE);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success() && errors.contains(expected),
            "{errors}"
        );
        let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(figures["fused"]["rms_percent"].as_f64().unwrap() < 1.0);
    }
}

#[test]
fn without_an_unloaded_turn_a_tare_gives_the_zero() {
    let folder = folder("unturned");
    let q = |t: f64| 0.8 * (1.1 * t).sin() * ((t - 2.0) / 2.0).clamp(0.0, 1.0);
    let tau = |t: f64| 7.0 * (2.1 * t).sin() + 3.0 * (0.7 * t).cos();
    fs::write(folder.join("train.csv"), log(6.0, q, tau)).unwrap();
    // Another zero of the motor-side encoder, as after a start.
    let run = log(5.0, |t| q(t + 3.0), |t| 6.0 * (3.0 * t).cos());
    let shifted = run.lines().map(|line| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if let Ok(theta) = cells[1].parse::<f64>() {
            cells[1] = (theta + 0.3).to_string();
        }
        cells.join(",") + "\n"
    });
    fs::write(folder.join("run.csv"), shifted.collect::<String>()).unwrap();
    let report = succeeds(
        &folder,
        "fit all --joint joint.toml --training train.csv -o fitted.toml",
    );
    assert!(
        report.contains("kinematic-error: not fitted: without an unloaded turn")
            && report.contains("torquectl estimate --tare"),
        "{report}"
    );
    let fitted = fs::read_to_string(folder.join("fitted.toml")).unwrap();
    assert!(fitted.contains("zero_unknown = true"), "{fitted}");
    let percent = |arguments: &str| {
        let json = succeeds(&folder, arguments);
        let figures: Value = serde_json::from_str(&json).unwrap();
        assert!(figures["fused"]["rms_percent"].is_number(), "{json}");
        figures["hysteresis"]["rms_percent"].as_f64().unwrap()
    };
    let estimate = "estimate --joint fitted.toml --log run.csv --json";
    let (tared, not) = (percent(&format!("{estimate} --tare 50")), percent(estimate));
    assert!(tared < 3.0 && not > 2.0 * tared, "{tared} {not}");
    for (count, expected) in [
        (
            "5000",
            "the log has 5000 rows, and --tare is 5000; allowed: less than 5000",
        ),
        ("0", "--tare"),
    ] {
        let refused = torquectl(&folder, &format!("{estimate} --tare {count}"));
        let errors = String::from_utf8_lossy(&refused.stderr);
        assert!(
            !refused.status.success() && errors.contains(expected),
            "{errors}"
        );
    }
}

#[test]
fn the_smallest_joint_and_a_log_without_torque() {
    let folder = folder("small");
    let text = log(1.0, |t| t.sin(), |_| 1.0);
    let bare: String = text
        .lines()
        .map(|line| format!("{}\r\n", line.rsplit_once(',').unwrap().0))
        .collect();
    fs::write(folder.join("run.csv"), bare).unwrap();
    let table = succeeds(&folder, "estimate --joint joint.toml --log run.csv");
    assert!(
        table.contains("current") && table.contains("1000 samples"),
        "{table}"
    );
    let json = succeeds(&folder, "estimate --joint joint.toml --log run.csv --json");
    let figures: Value = serde_json::from_str(&json).unwrap();
    assert!(figures["current"]["rms"].is_null() && figures["current"]["time_ns"].is_number());
    let refused = torquectl(
        &folder,
        "estimate --joint joint.toml --log run.csv --tare 9",
    );
    let errors = String::from_utf8_lossy(&refused.stderr);
    assert!(
        errors.contains("--tare, but the log has no column `tau_sensor`"),
        "{errors}"
    );
}

/// A row of a log with its stamp in ms.
fn in_ms(row: &str) -> String {
    match row.split_once(',') {
        Some((t, rest)) if t != "t" => format!("{},{rest}\n", 1e3 * t.parse::<f64>().unwrap()),
        _ => format!("{row}\n"),
    }
}

/// A fit that is ended in its middle, or while it writes, leaves the joint that there was, or has finished: never one
/// that cannot be used, nor one beside a network of another fit.
#[test]
fn an_interrupted_fit_leaves_the_joint_whole() {
    let folder = folder("interrupted");
    let turn = |t: f64| 3.3 * (0.45 * t - 1.5).sin();
    fs::write(folder.join("turn.csv"), log(14.0, turn, |_| 0.0)).unwrap();
    let q = |t: f64| (1.1 * t).sin();
    let trained = |gain: f64| {
        log(20.0, q, move |t| {
            gain * (7.0 * (2.1 * t).sin() + (0.7 * t).cos())
        })
    };
    fs::write(folder.join("old.csv"), trained(1.0)).unwrap();
    fs::write(folder.join("new.csv"), trained(0.8)).unwrap();
    fs::write(
        folder.join("run.csv"),
        log(1.0, q, |t| 8.0 * (3.0 * t).sin()),
    )
    .unwrap();
    succeeds(
        &folder,
        "fit all --joint joint.toml --no-load turn.csv --training old.csv -o fitted.toml",
    );
    let files = || {
        let entries = fs::read_dir(&folder).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let fitted = names.filter(|name| name.starts_with("fitted."));
        let read = |name: String| (fs::read(folder.join(&name)).unwrap(), name);
        let mut fitted: Vec<_> = fitted.map(read).collect();
        fitted.sort();
        fitted
    };
    let old = files();
    assert!(old.len() > 2, "a joint and what was trained for it");
    let again = "fit local-gp --joint fitted.toml --log new.csv -o fitted.toml";
    let began = Instant::now();
    succeeds(&folder, again);
    let whole = began.elapsed();
    let new = files();
    let differ = old.iter().zip(&new).filter(|(a, b)| a != b).count();
    assert!(differ >= 2, "joint and processes");
    let mut ended = 0;
    for (share, signal) in [
        (0.3, "INT"),
        (0.6, "TERM"),
        (0.8, "KILL"),
        (0.97, "KILL"),
        (1.0, "KILL"),
    ] {
        for (text, name) in &old {
            fs::write(folder.join(name), text).unwrap();
        }
        let mut child = Command::new(env!("CARGO_BIN_EXE_torquectl"))
            .args(again.split(' '))
            .current_dir(&folder)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        sleep(whole.mul_f64(share));
        let id = child.id().to_string();
        let _ = Command::new("kill").args(["-s", signal, &id]).output();
        ended += i32::from(!child.wait().unwrap().success());
        let found = files();
        assert!(
            found == old || found == new,
            "{signal} at {share}: files of two fits"
        );
        succeeds(&folder, "estimate --joint fitted.toml --log run.csv");
    }
    assert!(ended >= 2, "{ended} were ended before they had finished");
}
