//! The systemd unit, as systemd itself judges it.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

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
        "--threshold=20",
        "--no-pager",
        &unit,
    ];
    if let Some((good, answer)) = systemd_analyze(&security) {
        assert!(good, "{answer}");
    }
}

/// Address families that the unit lets the daemon's sockets have.
fn allowed_families() -> Vec<i32> {
    let text = std::fs::read_to_string(project_path("systemd/torqued@.service")).expect("a unit");
    let mut lines = text.lines();
    let names = lines.find_map(|line| line.strip_prefix("RestrictAddressFamilies="));
    let family = |name: &str| match name {
        "AF_UNIX" => libc::AF_UNIX,
        "AF_CAN" => libc::AF_CAN,
        "AF_INET" => libc::AF_INET,
        "AF_NETLINK" => libc::AF_NETLINK,
        other => panic!("unknown to this test: {other}"),
    };
    names
        .expect("families")
        .split_whitespace()
        .map(family)
        .collect()
}

/// As systemd's `RestrictAddressFamilies`: from now on this process gets no socket of other families.
fn restrict(families: &[i32]) -> io::Result<()> {
    let count = families.len() as u8;
    let load = (libc::BPF_LD | libc::BPF_W | libc::BPF_ABS) as u16;
    let equal = (libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K) as u16;
    let end = (libc::BPF_RET | libc::BPF_K) as u16;
    let line = |code, jt, jf, k: u32| libc::sock_filter { code, jt, jf, k };
    // Offsets in struct seccomp_data: the call's number, the lower half of its first argument.
    let mut program = vec![
        line(load, 0, 0, 0),
        line(equal, 0, count + 2, libc::SYS_socket as u32),
        line(load, 0, 0, 16),
    ];
    for (k, family) in (0..).zip(families) {
        program.push(line(equal, count - k, 0, *family as u32));
    }
    let refused = libc::SECCOMP_RET_ERRNO | libc::EAFNOSUPPORT as u32;
    program.push(line(end, 0, 0, refused));
    program.push(line(end, 0, 0, libc::SECCOMP_RET_ALLOW));
    let filter = libc::sock_fprog {
        len: program.len() as u16,
        filter: program.as_mut_ptr(),
    };
    // SAFETY: plain system calls; `filter` and `program` live until they have returned.
    let set = unsafe {
        libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
            && libc::prctl(libc::PR_SET_SECCOMP, libc::SECCOMP_MODE_FILTER, &filter) == 0
    };
    if set {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}

/// Output of the daemon when it runs this configuration with sockets of these families only.
fn run_restricted(config: &str, directory: &TemporaryDirectory, families: Vec<i32>) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
    command
        .args(["run", config, "--seconds", "0.2"])
        .env("TORQUED_RUN_DIR", directory.path())
        .env("STATE_DIRECTORY", directory.path().join("state"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    // SAFETY: between fork and exec it calls prctl and allocates, which glibc allows a forked process.
    unsafe { command.pre_exec(move || restrict(&families)) };
    let out = command.output().expect("torqued runs");
    String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned()
}

/// The leg with its bus on the loopback interface, by UDP.
fn leg_by_udp(directory: &TemporaryDirectory) -> String {
    let text = std::fs::read_to_string(project_path("config/leg/robot.toml")).expect("read");
    let models = project_path("robot-models");
    let mut port = 43_500;
    let lines = text.lines().map(|line| {
        if line.starts_with("interface = ") {
            port += 1;
            format!("kind = \"udp_multicast\"\ninterface = \"lo\"\nport = {port}")
        } else {
            line.replace("../../robot-models", &models)
        }
    });
    let text: Vec<String> = lines
        .filter(|line| !line.starts_with("calibration"))
        .collect();
    std::fs::create_dir_all(directory.path()).expect("made");
    let path = directory.path().join("robot.toml");
    std::fs::write(&path, text.join("\n")).expect("written");
    path.display().to_string()
}

#[test]
fn the_unit_allows_the_sockets_that_every_kind_of_bus_needs() {
    let directory = TemporaryDirectory::new();
    let by_udp = leg_by_udp(&directory);
    let by_can = project_path("config/leg/robot.toml");
    let cases = [
        (&by_udp, vec![libc::AF_INET, libc::AF_NETLINK]),
        (&by_can, vec![libc::AF_CAN]),
    ];
    for (config, needed) in cases {
        // Without a filter the same may fail for other reasons: a kernel without CAN.
        let everything: Vec<i32> = (0..64).collect();
        let unrestricted = run_restricted(config, &directory, everything);
        let allowed = run_restricted(config, &directory, allowed_families());
        let of_interest = |text: &str| -> Vec<String> {
            let lines = text.lines().filter(|line| {
                ["socket", "interface", "group", "address"]
                    .iter()
                    .any(|word| line.contains(word))
            });
            lines.map(str::to_owned).collect()
        };
        assert_eq!(of_interest(&allowed), of_interest(&unrestricted));
        // The test notices a family that is missing.
        for family in needed {
            let mut fewer = allowed_families();
            fewer.retain(|own| *own != family);
            let without = run_restricted(config, &directory, fewer);
            let noticed = of_interest(&without) != of_interest(&unrestricted);
            let no_can = family == libc::AF_CAN && unrestricted.contains("modprobe can_raw");
            assert!(noticed || no_can, "{family}: {without}");
        }
    }
}
