//! What other programs write: `torquectl import` of tables of several topics and of other
//! formats; `torquectl check` of files in their encodings.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const JOINT: &str = r#"
[[joint]]
name = "elbow"
gear_ratio = 100
theta = { column = "th", unit = "rad" }
q = { column = "q", unit = "rad" }
i = { column = "i", unit = "A" }
"#;

fn q(t: f64) -> f64 {
    0.8 * (2.5 * t).sin()
}

fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("import-formats-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn import(folder: &Path, map: &str, log: &str, bytes: &[u8]) -> Output {
    let _ = fs::remove_dir_all(folder.join("out"));
    fs::write(folder.join("map.toml"), map).unwrap();
    fs::write(folder.join(log), bytes).unwrap();
    Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(["import", "map.toml", log, "-o", "out"])
        .current_dir(folder)
        .output()
        .unwrap()
}

/// The converted log is the motion: 600 rows at 200 Hz.
fn assert_motion(folder: &Path, output: &Output, what: &str) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{what}: {message}");
    let text = fs::read_to_string(folder.join("out/log.elbow.csv")).unwrap();
    let rows: Vec<Vec<f64>> = (text.lines().skip(1))
        .map(|line| line.split(',').map(|x| x.parse().unwrap()).collect())
        .collect();
    assert!((598..=601).contains(&rows.len()), "{what}: {}", rows.len());
    for row in &rows {
        let near = |t: f64| (row[2] - q(t)).abs() < 2e-3 && (row[1] - 100.0 * q(t)).abs() < 0.2;
        // The grid begins with the later of two topics.
        assert!(
            (0..4).any(|k| near(row[0] + 1e-3 * f64::from(k))),
            "{what}: {row:?}"
        );
    }
}

/// The link's topic at 200 Hz, the motor's 0.2 ms (or 2 ms) later, each with rows of its own; `absent`
/// stands in the other's cells, `stamp` writes a time.
fn sparse(delimiter: &str, absent: &str, stamp: &dyn Fn(f64) -> String, header: &str) -> String {
    let mut text = format!("{header}\n");
    for k in 0..601 {
        let t = 5e-3 * f64::from(k);
        let link = [stamp(t), absent.into(), q(t).to_string(), absent.into()];
        let t = t + 2e-4;
        let theta = (100.0 * q(t)).to_string();
        let motor = [stamp(t), theta, absent.into(), "0.5".into()];
        for row in [link, motor] {
            text += &(row.join(delimiter) + "\n");
        }
    }
    text
}

fn map(time: &str) -> String {
    format!("sample_rate_hz = 200\n[time]\n{time}{JOINT}")
}

#[test]
fn topics_have_the_stamps_of_their_own_rows() {
    let folder = folder("sparse");
    let seconds = |t: f64| format!("{t:.6}");
    let plain = map("column = \"t\"\nunit = \"s\"");
    let comma = sparse(",", "", &seconds, "t,th,q,i");
    let cases = [
        ("empty", comma.clone()),
        ("nan", sparse(",", "NaN", &seconds, "t,th,q,i")),
        (
            "quoted",
            sparse(
                "\",\"",
                "",
                &|t| format!("\"{t:.6}"),
                "\"t\",\"th\",\"q\",\"i",
            )
            .replace('\n', "\"\n"),
        ),
        ("tabs", sparse("\t", "", &seconds, "t\tth\tq\ti")),
        (
            "decimal commas",
            sparse(";", "", &seconds, "t;th;q;i").replace('.', ","),
        ),
        (
            "other columns",
            comma.replace("\n", ",\n").replacen(",\n", ",note\n", 1),
        ),
    ];
    for (what, log) in cases {
        let output = import(&folder, &plain, "log.csv", log.as_bytes());
        assert_motion(&folder, &output, what);
    }
    // Windows-1252 in a name that the map does not use, and one that it does.
    let bytes = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
    let log = comma.replacen("t,th,q,i", "t,th,\u{e9},i", 1);
    let named = plain.replace("\"q\"", "\"\u{e9}\"");
    assert_motion(
        &folder,
        &import(&folder, &named, "log.csv", &bytes(&log)),
        "Windows-1252",
    );
}

#[test]
fn stamps_may_be_split_and_of_each_topic() {
    let folder = folder("stamps");
    let split = |t: f64| {
        let ns = (t * 1e9).round() as u64;
        format!(
            "{},{}",
            1_750_000_000 + ns / 1_000_000_000,
            ns % 1_000_000_000
        )
    };
    let log = sparse(",", "", &split, "sec,nanosec,th,q,i");
    let time = "column = \"sec\"\nunit = \"s\"\nplus = [{ column = \"nanosec\", unit = \"ns\" }]";
    let output = import(&folder, &map(time), "log.csv", log.as_bytes());
    assert_motion(&folder, &output, "seconds and nanoseconds");

    // Two tables side by side, each with stamps of its own.
    let mut text = "t_motor,th,i,t_link,q\n".to_owned();
    for k in 0..601 {
        let t = 5e-3 * f64::from(k);
        let late = t + 2e-4;
        text += &format!("{late},{},0.5,{},{}\n", 100.0 * q(late), 1e3 * t, q(t));
    }
    let own = map("column = \"t_motor\"\nunit = \"s\"").replace(
        "column = \"q\", unit = \"rad\"",
        "column = \"q\", unit = \"rad\", time = { column = \"t_link\", unit = \"ms\" }",
    );
    assert_motion(
        &folder,
        &import(&folder, &own, "log.csv", text.as_bytes()),
        "two stamps",
    );
}

#[test]
fn tables_that_mean_nothing_certain_are_refused() {
    let folder = folder("refused");
    let plain = map("column = \"t\"\nunit = \"s\"");
    let seconds = |t: f64| format!("{t:.6}");
    let sound = sparse(",", "", &seconds, "t,th,q,i");
    let cases = [
        (
            sound.replacen("t,th,q,i", "t,th,q,q", 1),
            "log.csv:1: column `q` is named twice, as the columns 3 and 4",
        ),
        (
            sound.replacen("\n0.005000,", "\n,", 1),
            "log.csv:4: `t` is empty where `q` is",
        ),
        (
            sound.replacen("\n0.010000,", "\n0.001,", 1),
            "log.csv:6: `t` is 0.001 after 0.005",
        ),
        (
            sparse(",", "-", &seconds, "t,th,q,i"),
            "log.csv:2: `i` is `-`; allowed: a finite number",
        ),
        (
            sparse(",", "", &seconds, "t,th,q,i").replace(",0.5\n", ",\n"),
            "log.csv: `i` has 0 values; allowed: at least two",
        ),
        (
            sound.replace('.', ","),
            "log.csv:3: the row has 7 fields, the header 4",
        ),
    ];
    for (log, expected) in cases {
        let output = import(&folder, &plain, "log.csv", log.as_bytes());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{expected}: {message}");
        assert!(message.contains(expected), "{expected}\n{message}");
        assert!(!folder.join("out").exists());
    }
}

#[test]
fn other_formats_are_named_with_what_converts_them() {
    let folder = folder("formats");
    let plain = map("column = \"t\"\nunit = \"s\"");
    let cases: [(&str, &[u8], &str); 7] = [
        (
            "log.bag",
            b"#ROSBAG V2.0\nE\0\0\0",
            "is a bag of ROS 1; allowed: the MCAP file that `pip install rosbags && rosbags-convert --src log.bag --dst log --dst-storage mcap`",
        ),
        ("log.csv", b"#ROSBAG V2.0\n", "is a bag of ROS 1"),
        (
            "log.db3.zstd",
            b"\x28\xB5\x2F\xFD\0\0",
            "is compressed with zstd",
        ),
        ("log.csv.gz", b"\x1F\x8B\x08\0", "is compressed with gzip"),
        (
            "log.xlsx",
            b"PK\x03\x04\0\0",
            "is a ZIP archive or a spreadsheet",
        ),
        (
            "log.db3",
            b"SQLite format 3\0 and no more",
            "is SQLite, but no recording that can be read: file is not a database; allowed: a recording of rosbag2",
        ),
        ("log.mcap", b"t,th,q,i\n0,1,2,3\n", "is not an MCAP file"),
    ];
    for (log, bytes, expected) in cases {
        let output = import(&folder, &plain, log, bytes);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{expected}: {message}");
        assert!(message.contains(expected), "{expected}\n{message}");
    }
    fs::create_dir(folder.join("bag")).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(["import", "map.toml", "bag", "-o", "out"])
        .current_dir(&folder)
        .output()
        .unwrap();
    assert!(
        String::from_utf8_lossy(&output.stderr)
            .contains("bag: is a folder; allowed: a file; of a recording of rosbag2 the .mcap")
    );
}

/// CANdb++ writes Windows-1252, editors under Windows write byte-order marks.
#[test]
fn a_robots_files_are_read_in_every_usual_encoding() {
    const FILES: [&str; 3] = [
        "config/leg/robot.toml",
        "robot-models/leg/robot.urdf",
        "robot-models/leg/drives.dbc",
    ];
    let folder = folder("encodings");
    for file in FILES {
        let copy = folder.join(file);
        fs::create_dir_all(copy.parent().unwrap()).unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        fs::copy(root.join(file), copy).unwrap();
    }
    let check = || {
        Command::new(env!("CARGO_BIN_EXE_torquectl"))
            .args(["check", FILES[0]])
            .current_dir(&folder)
            .output()
            .unwrap()
    };
    let summed_up = check().stdout;
    let encoded = |file: &str, encode: &dyn Fn(&str) -> Vec<u8>| {
        let path = folder.join(file);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, encode(&text)).unwrap();
        let output = check();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{file}: {stderr}");
        assert_eq!(output.stdout, summed_up, "{file}");
        fs::write(&path, text).unwrap();
    };
    let windows_1252 = |text: &str| -> Vec<u8> {
        let bytes = text.chars().map(|letter| u8::try_from(letter).unwrap());
        bytes.collect()
    };
    encoded(FILES[2], &|text| {
        let lines = text.replace('\n', "\r\n");
        windows_1252(&(lines + "CM_ \"\u{b0}C M\u{fc}ller\";\r\n"))
    });
    encoded(FILES[1], &|text| {
        windows_1252(&text.replacen("<robot ", "<!-- \u{b0} --><robot ", 1))
    });
    for file in FILES {
        encoded(file, &|text| format!("\u{feff}{text}").into_bytes());
        encoded(file, &|text| {
            let units = text.encode_utf16().flat_map(u16::to_le_bytes);
            [0xFF, 0xFE].into_iter().chain(units).collect()
        });
    }
}
