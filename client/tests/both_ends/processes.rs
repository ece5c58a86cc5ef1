//! Both ends in processes of their own, some of them killed.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use crate::common::RunDir;
use torqued_client::robot_state::{Mode, Reference};
use torqued_client::{Client, Commander, Error, Record};

const PATIENCE: Duration = Duration::from_secs(10);

/// One of this package's example programs; killed with SIGKILL when dropped.
struct Process {
    child: Child,
    output: BufReader<std::process::ChildStdout>,
}

impl Process {
    fn start(example: &str, dir: &RunDir) -> Self {
        let mut path: PathBuf = std::env::current_exe().expect("own path");
        path.pop();
        path.pop();
        path.push("examples");
        path.push(example);
        let mut child = Command::new(&path)
            .arg("leg")
            .env("TORQUED_RUN_DIR", dir.location.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|e| panic!("{}: {e}; cargo build --examples makes it", path.display()));
        let output = BufReader::new(child.stdout.take().expect("piped"));
        Self { child, output }
    }

    fn daemon(dir: &RunDir) -> Self {
        let mut daemon = Self::start("stand_in_daemon", dir);
        assert_eq!(daemon.line(), "publishing leg\n");
        daemon
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).expect("text");
        line
    }

    fn kill(mut self) {
        self.child.kill().expect("killed with SIGKILL");
        self.child.wait().expect("gone");
    }

    fn end(mut self) -> (ExitStatus, String) {
        let status = self.child.wait().expect("ended");
        let error = std::io::read_to_string(self.child.stderr.take().expect("piped"));
        (status, error.expect("text"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn connect(dir: &RunDir) -> Client {
    Client::connect_at(&dir.location, "leg", PATIENCE).expect("a daemon runs")
}

fn wait_for(client: &mut Client, condition: impl Fn(&Record) -> bool) -> Record {
    for record in client.records(PATIENCE).take(20_000) {
        let record = record.expect("the daemon publishes");
        if condition(&record) {
            return record;
        }
    }
    panic!("no such record in 20,000");
}

#[test]
fn every_cycle_reaches_a_client_in_another_process() {
    let dir = RunDir::new();
    let _daemon = Process::daemon(&dir);
    let mut client = connect(&dir);
    assert_eq!(client.description().joint_names[5].as_str(), "joint_5");
    let first = client.next_record(PATIENCE).expect("record").cycle.sequence;
    for sequence in first + 1..first + 500 {
        let record = client.next_record(PATIENCE).expect("record");
        assert_eq!((record.cycle.sequence, record.lost), (sequence, 0));
        let t = sequence as f64 * 1e-3;
        let tau = record.cycle.estimated.joints[2].tau_whole_body.tau;
        assert!((tau - (2.0 + t.sin())).abs() < 1e-12, "{tau} at {t}");
    }
}

#[test]
fn clients_go_on_when_the_daemon_is_killed_and_started_again() {
    let dir = RunDir::new();
    let daemon = Process::daemon(&dir);
    let mut client = connect(&dir);
    let mut commander = Commander::connect(&mut client).expect("commander");
    wait_for(&mut client, |r| r.cycle.sequence > 200);
    daemon.kill();
    let _daemon = Process::daemon(&dir);
    wait_for(&mut client, |r| r.cycle.sequence < 200);
    let torque = |r: &mut Reference| r.mode = Mode::Torque.number();
    let mut errors = 0;
    for record in client.records(PATIENCE).take(200) {
        match commander.send(torque) {
            Err(Error::CommandLost { .. }) => errors += 1,
            // Before the new daemon's first status has arrived.
            other => assert!(errors == 0, "{other:?}"),
        }
        assert_eq!(record.expect("record").cycle.mode, Mode::Hold.number());
    }
    assert!(errors > 0, "it notices");
    // Followed again once it has asked for hold, and its next reference at once.
    commander
        .send(|r| r.mode = Mode::Hold.number())
        .expect("sent");
    commander.send(torque).expect("sent");
    wait_for(&mut client, |r| r.cycle.mode == Mode::Torque.number());
    let mut newcomer = connect(&dir);
    newcomer
        .next_record(PATIENCE)
        .expect("newcomers are served too");
}

#[test]
fn a_daemon_starts_over_what_a_killed_one_left() {
    let dir = RunDir::new();
    for _ in 0..3 {
        Process::daemon(&dir).kill();
    }
    let error = Client::connect_at(&dir.location, "leg", Duration::from_millis(100));
    assert!(error.is_err(), "no publisher");
    let _daemon = Process::daemon(&dir);
    connect(&dir).next_record(PATIENCE).expect("record");
}

#[test]
fn the_example_tares() {
    let dir = RunDir::new();
    let _daemon = Process::daemon(&dir);
    let mut example = Process::start("03_tare", &dir);
    let mut printed = String::new();
    while let line @ 1.. = example.output.read_line(&mut printed).expect("text") {
        assert!(line < 200);
    }
    assert!(
        printed.contains("ankle") && printed.contains("3.00 N"),
        "{printed}"
    );
    assert!(example.end().0.success());
}

#[test]
fn killed_clients_make_room_for_others() {
    let dir = RunDir::new();
    let _daemon = Process::daemon(&dir);
    // More than can be connected at once.
    for _ in 0..12 {
        let mut reader = Process::start("01_print_torques", &dir);
        assert!(reader.line().starts_with("cycle "));
        assert!(reader.line().contains("joint_0"));
        reader.kill();
    }
    connect(&dir).next_record(PATIENCE).expect("record");
}

#[test]
fn the_command_passes_on_when_its_holder_is_killed() {
    let dir = RunDir::new();
    let _daemon = Process::daemon(&dir);
    let mut client = connect(&dir);
    for _ in 0..3 {
        let holder = Process::start("02_send_references", &dir);
        wait_for(&mut client, |r| {
            r.cycle.mode == Mode::InverseDynamics.number()
        });
        holder.kill();
        wait_for(&mut client, |r| r.cycle.mode == Mode::Hold.number());
    }
    let mut commander = Commander::connect(&mut client).expect("the command is free again");
    commander
        .send(|r| r.mode = Mode::Torque.number())
        .expect("sent");
    wait_for(&mut client, |r| r.cycle.mode == Mode::Torque.number());
}

#[test]
fn one_client_commands_and_a_second_is_refused() {
    let dir = RunDir::new();
    let _daemon = Process::daemon(&dir);
    let mut client = connect(&dir);
    let first = Process::start("02_send_references", &dir);
    wait_for(&mut client, |r| {
        r.cycle.mode == Mode::InverseDynamics.number()
    });
    let (status, error) = Process::start("02_send_references", &dir).end();
    assert!(
        !status.success() && error.contains("commanded by another client: process "),
        "{status} {error}"
    );
    let (status, error) = first.end();
    assert!(status.success(), "{error}");
    wait_for(&mut client, |r| r.cycle.mode == Mode::Hold.number());
}
