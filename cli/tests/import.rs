//! `torquectl import` as a whole process: units, signs, sums, gaps, and every kind of bad map.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const MAP: &str = r#"
sample_rate_hz = 500
delimiter = ";"
[time]
column = "stamp"
unit = "us"
[[joint]]
name = "knee"
gear_ratio = 100
theta = { column = "m", unit = "counts", counts_per_turn = 4096, sign = -1, wraps = true }
q = { column = "l", unit = "deg", offset = 0.5 }
i = { column = "mA", unit = "mA" }
tau_sensor = { column = "fx", unit = "1", scale = -0.5, plus = [{ column = "ty", unit = "Nm" }] }
tau_feedforward = { column = "ff", unit = "kNm" }
[[joint]]
name = "ankle"
gear_ratio = 50
theta = { column = "l", unit = "deg", side = "link" }
q = { column = "l", unit = "deg" }
i = { column = "mA", unit = "mA" }
[[ft_sensor]]
name = "foot"
columns = ["fx", "fx", "fx", "ty", "ty", "ty"]
signs = [1, 1, -1, 1, 1, -1]
"#;

/// 0.4 s at 1 kHz with jitter; lines from 200 to 230 are missing.
fn log() -> String {
    log_at(1200)
}

/// The motor turns by 7/SLOWNESS a row.
fn log_at(slowness: i64) -> String {
    let mut text = "stamp;m;l;mA;fx;ty;ff;note\n".to_owned();
    for k in 0..400i32 {
        if (200..230).contains(&k) {
            continue;
        }
        let t = f64::from(k) + 0.1 * f64::from(k * k % 3);
        let motor = (-(7 * 4096 * i64::from(k)) / slowness + 100).rem_euclid(4096);
        text += &format!(
            "{};{motor};{};{};{};2.5;0.001;x\n",
            1e3 * t,
            9.0 * t,
            10.0 * t,
            2.0 * t
        );
    }
    text
}

fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("import-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("map.toml"), MAP).unwrap();
    fs::write(folder.join("run.csv"), log()).unwrap();
    folder
}

fn import(folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(["import", "map.toml", "run.csv", "-o", "out"])
        .current_dir(folder)
        .output()
        .unwrap()
}

fn rows(path: &Path) -> (String, Vec<Vec<f64>>) {
    let text = fs::read_to_string(path).unwrap();
    let (header, rest) = text.split_once('\n').unwrap();
    let row = |line: &str| line.split(',').map(|x| x.parse().unwrap()).collect();
    (header.to_owned(), rest.lines().map(row).collect())
}

#[test]
fn columns_become_channels() {
    let folder = folder("channels");
    let output = import(&folder);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let (header, knee) = rows(&folder.join("out/run.knee.csv"));
    assert_eq!(header, "t,theta,q,i,tau_sensor,tau_feedforward");
    assert!((175..=190).contains(&knee.len()), "{}", knee.len());
    let first = &knee[2];
    for row in &knee[2..] {
        let [t, theta, q, i, tau, ff] = row[..] else {
            panic!()
        };
        let ms = 1e3 * t;
        // 7/1200 of a motor turn a row of 1 ms.
        let turns = (theta - first[1]) / std::f64::consts::TAU;
        assert!(
            (turns - 7.0 / 1200.0 * 1e3 * (t - first[0])).abs() < 0.04,
            "{t} {turns}"
        );
        assert!((q - 0.5 - (9.0 * ms).to_radians()).abs() < 3e-2, "{t} {q}");
        assert!(
            (i - 0.01 * ms).abs() < 2e-3 && (tau - 2.5 + ms).abs() < 0.2,
            "{t} {i} {tau}"
        );
        assert!((ff - 1.0).abs() < 1e-12);
        assert!(
            !(0.203..0.228).contains(&t),
            "rows in the gap are left out: {t}"
        );
    }
    let (_, ankle) = rows(&folder.join("out/run.ankle.csv"));
    assert!(ankle.iter().all(|r| (r[1] - 50.0 * r[2]).abs() < 1e-9));
    let (header, robot) = rows(&folder.join("out/run.csv"));
    assert!(
        header.starts_with("t,knee.theta,knee.q,knee.i,knee.tau_sensor"),
        "{header}"
    );
    assert!(
        header.ends_with("foot.fx,foot.fy,foot.fz,foot.tx,foot.ty,foot.tz"),
        "{header}"
    );
    assert!(
        robot
            .iter()
            .all(|r| (r[r.len() - 4] + r[r.len() - 6]).abs() < 1e-9)
    );
}

#[test]
fn bad_maps_and_logs_are_named_with_file_and_line() {
    let folder = folder("bad");
    let map = |from: &str, to: &str| MAP.replacen(from, to, 1);
    let good = log();
    let cases = [
        (
            map("column = \"m\"", "column = \"motor\""),
            good.clone(),
            "map.toml:10: run.csv has no column `motor` among stamp, m, l, mA, fx, ty, ff, note; allowed: a column of the log",
        ),
        (
            map("unit = \"deg\", offset", "unit = \"mA\", offset"),
            good.clone(),
            "map.toml:11: q: another quantity's unit; allowed: rad, deg",
        ),
        (
            map("counts_per_turn = 4096, ", ""),
            good.clone(),
            "map.toml:10: unit = \"counts\" without `counts_per_turn`",
        ),
        (
            map("sign = -1", "sign = 2"),
            good.clone(),
            "map.toml:10: theta.sign is 2; allowed: 1 or -1",
        ),
        (
            map("gear_ratio = 50", ""),
            good.clone(),
            "side = \"link\"; allowed: for theta, of a joint with `gear_ratio`",
        ),
        (
            map("[time]", "[tme]"),
            good.clone(),
            "map.toml:4: unknown field `tme`",
        ),
        (
            map("\"us\"", "\"h\""),
            good.clone(),
            "map.toml:6: unknown variant `h`",
        ),
        (
            map("name = \"ankle\"", "name = \"knee\""),
            good.clone(),
            "\"knee\" is named twice",
        ),
        (
            map("name = \"ankle\"", "name = \"../ankle\""),
            good.clone(),
            "allowed: a name without",
        ),
        (
            map("= 500", "= -1"),
            good.clone(),
            "sample_rate_hz is -1; allowed: a finite number > 0",
        ),
        (
            MAP.to_owned(),
            good.replacen(";2.5;", ";oops;", 1),
            "run.csv:2: `ty` is `oops`",
        ),
        (
            MAP.to_owned(),
            good.replacen("\n3000;", "\n0;", 1),
            "run.csv:5: `stamp` is 0 after 2100",
        ),
        (
            MAP.to_owned(),
            good.lines().take(2).collect::<Vec<_>>().join("\n"),
            "run.csv: the log has",
        ),
    ];
    let cases = cases.into_iter().chain([(
        MAP.to_owned(),
        log_at(40),
        "map.toml:10: theta: wraps = true, but turns before t = 0.23",
    )]);
    for (map, log, expected) in cases {
        fs::write(folder.join("map.toml"), map).unwrap();
        fs::write(folder.join("run.csv"), log).unwrap();
        let output = import(&folder);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{expected}: {message}");
        assert!(message.contains(expected), "{expected}\n{message}");
        assert!(!folder.join("out").exists(), "nothing is written");
    }
}
