//! Wrong arguments, logs and settings of joints: named with their places, and nothing is written.

use super::{folder, in_ms, log, succeeds, torquectl};
use std::fmt::Write as _;
use std::fs;

#[test]
fn bad_input_is_named_with_file_and_line() {
    let folder = folder("bad");
    let good = log(1.0, |t| (7.0 * t).sin(), |t| (9.0 * t).cos());
    let replaced = |line: usize, with: &str| {
        let mut lines: Vec<&str> = good.lines().collect();
        lines[line - 1] = with;
        lines.join("\n")
    };
    let cases = [
        (
            replaced(1, "t,theta,i,tau_sensor"),
            "run.csv:1: column `q` is missing",
        ),
        (
            replaced(1, "t,q,q,i,theta"),
            "run.csv:1: column `q` is named twice",
        ),
        (replaced(7, "0.0055,1,NaN,0,0"), "run.csv:7: `q` is `NaN`"),
        (replaced(7, "0.0055,1,oops,0,0"), "run.csv:7: `q` is `oops`"),
        (
            replaced(7, "0.0055,1"),
            "run.csv:7: the field of column `q` is missing",
        ),
        (
            replaced(7, "0.002,1,1,1,1"),
            "run.csv:7: time 0.002 s follows 0.004 s",
        ),
        (good.lines().map(in_ms).collect(), "run.csv: `t` is in ms"),
        (String::new(), "run.csv:1: the log is empty"),
        ("t,theta,q,i\n".to_owned(), "run.csv:2: the log has no rows"),
        (
            format!("t,theta,q,i\n{}", "7".repeat(70_000)),
            "run.csv:2: the line is too long",
        ),
    ];
    for (text, expected) in cases {
        fs::write(folder.join("run.csv"), text).unwrap();
        for command in [
            "estimate --joint joint.toml --log run.csv",
            "fit kinematic-error --joint joint.toml --log run.csv -o out.toml",
        ] {
            let output = torquectl(&folder, command);
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{command}: {message}");
            assert!(message.contains(expected), "{expected}\n{message}");
        }
    }
    let message = |arguments: &str| {
        let output = torquectl(&folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    fs::write(folder.join("run.csv"), &good).unwrap();
    let one_way = message("fit kinematic-error --joint joint.toml --log run.csv -o out.toml");
    assert!(one_way.contains("run.csv: no-load turn: the"), "{one_way}");
    let early = message("fit kalman --joint joint.toml --log run.csv -o out.toml");
    assert!(early.contains("allowed: a table [compliance]"), "{early}");
    let nowhere = message("estimate --joint nowhere.toml --log run.csv");
    assert!(
        nowhere.contains("nowhere.toml: cannot be read: No such file"),
        "{nowhere}"
    );
    let name = message("fit current --joint joint.toml --log run.csv -o out.csv");
    assert!(
        name.contains("--out out.csv: no name of a joint file; allowed: a name in .toml"),
        "{name}"
    );
    let nowhere = message("fit current --joint joint.toml --log run.csv -o nowhere/out.toml");
    assert!(nowhere.contains("nowhere is not a folder"), "{nowhere}");
    assert!(
        !folder.join("out.toml").exists(),
        "nothing is written that was not fitted"
    );
}

/// Every wrong log of a joint that is otherwise right: exit code 2, its cause on stderr, no file
/// written, and a file that is there untouched.
#[test]
fn wrong_logs_write_nothing() {
    let folder = folder("wrong");
    let q = |t: f64| (1.1 * t).sin();
    let tau = |t: f64| 7.0 * (2.1 * t).sin() + 3.0 * (0.7 * t).cos();
    let good = log(12.0, q, tau);
    fs::write(folder.join("good.csv"), &good).unwrap();
    type Change<'a> = &'a dyn Fn(&mut [f64; 5]);
    let changed = |change: Change<'_>| {
        let mut text = "t,theta,q,i,tau_sensor\n".to_owned();
        for line in good.lines().skip(1) {
            let mut values = [0.0; 5];
            for (value, field) in values.iter_mut().zip(line.split(',')) {
                *value = field.parse().unwrap();
            }
            change(&mut values);
            writeln!(text, "{}", values.map(|x| x.to_string()).join(",")).unwrap();
        }
        text
    };
    let cases: [(Change<'_>, &str); 8] = [
        (&|r| r[0] *= 1e3, "`t` is in ms"),
        (&|r| r[1] = -r[1], "reversed"),
        (
            &|r| (r[1], r[2]) = (r[1].to_degrees(), r[2].to_degrees()),
            "degrees",
        ),
        (&|r| r[3] = 0.2, "`i` is constant"),
        (&|r| r[0] *= 2.0, "`sample_rate_hz`"),
        (&|r| r[4] = 5.0 * r[3], "computed from the current"),
        (&|r| r[4] = -r[4], "reversed"),
        (&|r| r[4] = r[4].clamp(-4.0, 4.0), "`tau_sensor` is clipped"),
    ];
    let kept = "# kept\n";
    for (change, expected) in cases {
        fs::write(folder.join("wrong.csv"), changed(change)).unwrap();
        fs::write(folder.join("out.toml"), kept).unwrap();
        for command in [
            "fit compliance --joint joint.toml --log wrong.csv -o out.toml",
            "fit all --joint joint.toml --no-load good.csv --training wrong.csv -o out.toml",
        ] {
            let output = torquectl(&folder, command);
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{expected}: {message}");
            assert!(
                message.contains("wrong.csv: ") && message.contains(expected),
                "{message}"
            );
        }
        assert_eq!(fs::read_to_string(folder.join("out.toml")).unwrap(), kept);
        assert!(!folder.join("out.network.toml").exists());
    }
    let report = succeeds(
        &folder,
        "fit current --joint joint.toml --log good.csv -o new.toml",
    );
    assert!(report.contains("good.csv: torque -"), "{report}");
}

/// A logger that is killed leaves half a row: it is left out, and that is printed.
#[test]
fn a_row_that_the_end_of_the_file_cuts_is_reported() {
    let folder = folder("cut");
    let good = log(2.0, |t| (7.0 * t).sin(), |t| (9.0 * t).cos());
    let end = good.trim_end().rfind(',').unwrap();
    for (text, cut) in [(good.as_str(), false), (&good[..end], true)] {
        fs::write(folder.join("run.csv"), text).unwrap();
        for command in [
            "estimate --joint joint.toml --log run.csv --accept",
            "fit kinematic-error --joint joint.toml --log run.csv -o out.toml",
        ] {
            let output = torquectl(&folder, command);
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            let warned = message.contains("run.csv: the file ends within its last row");
            assert_eq!(warned, cut, "{command}: {message}");
        }
    }
}
