//! Another user of the machine keeps neither a stop from stopping nor a restart from starting.
//!
//! Runs in a mount namespace with a `/dev/shm` of its own, which user nobody writes into, fills, and
//! takes names in.

use crate::common;

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use common::RunDir;
use robot_state::{Mode, RobotState};
use test_support::project_path;
use torqued_client::{Client, Commander, Error, Location, running_daemons};

const NOBODY: u32 = 65_534;
const PATIENCE: Duration = Duration::from_secs(30);

struct Daemon {
    process: Child,
    said: Arc<Mutex<String>>,
}

impl Daemon {
    fn start(run: &RunDir) -> Self {
        let config = patient_leg(run);
        let mut process = Command::new(env!("CARGO_BIN_EXE_torqued"))
            .args(["run", &config, "--simulate", "--seconds", "100"])
            .env("TORQUED_RUN_DIR", run.location.path())
            .env("STATE_DIRECTORY", run.directory.path().join("state"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("torqued runs");
        let said = Arc::new(Mutex::new(String::new()));
        let (lines, heard) = (process.stderr.take().expect("piped"), Arc::clone(&said));
        std::thread::spawn(move || {
            for line in BufReader::new(lines).lines().map_while(Result::ok) {
                let mut heard = heard.lock().expect("a text");
                heard.push_str(&line);
                heard.push('\n');
            }
        });
        Self { process, said }
    }

    fn wait_for(&self, words: &str) {
        let until = Instant::now() + PATIENCE;
        while !self.said.lock().expect("a text").contains(words) {
            assert!(Instant::now() < until, "{words:?} in {}", self.said());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn said(&self) -> String {
        self.said.lock().expect("a text").clone()
    }

    fn end(mut self) {
        let id = self.process.id().to_string();
        let _ = Command::new("kill").args(["-TERM", &id]).status();
        let _ = self.process.wait();
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The leg, whose clients keep the command for a second on a machine without free processors.
fn patient_leg(run: &RunDir) -> String {
    let folder = project_path("config/leg");
    let absolute = |name: &str| {
        let text = std::fs::read_to_string(format!("{folder}/{name}")).expect("the leg");
        text.replace("\"../", &format!("\"{folder}/../"))
    };
    let (old, new) = (
        "reference_timeout_ms = 40.0",
        "reference_timeout_ms = 1000.0",
    );
    let text = absolute("robot.toml");
    assert!(text.contains(old));
    let place = run.directory.path();
    std::fs::write(place.join("sim.toml"), absolute("sim.toml")).expect("written");
    let path = place.join("robot.toml");
    std::fs::write(&path, text.replace(old, new)).expect("written");
    path.display().to_string()
}

/// What a shell of user nobody prints.
fn as_nobody(script: &str) -> String {
    let out = Command::new("sh")
        .args(["-c", script])
        .uid(NOBODY)
        .gid(NOBODY)
        .current_dir("/")
        .output()
        .expect("a shell");
    String::from_utf8_lossy(&out.stdout).into_owned()
}

fn connect(run: &RunDir, daemon: &Daemon) -> Client {
    // The names may be others after a restart.
    let location = Location::at(run.location.path()).expect("a run directory");
    let client = Client::connect_at(&location, "leg", PATIENCE);
    client.unwrap_or_else(|why| panic!("{why}: {}", daemon.said()))
}

/// Everything that is open to nobody in `/dev/shm`: written into, cut short, removed, renamed.
const SPOIL: &str = "for f in /dev/shm/torqued*; do
    [ -L \"$f\" ] && continue # nobody's own
    (printf 0123456789abcdef 1<>\"$f\") 2>/dev/null && echo written $f
    (: >\"$f\") 2>/dev/null && echo cut $f
    chmod 666 \"$f\" 2>/dev/null && echo opened $f
    rm -f \"$f\" 2>/dev/null && echo removed $f
    ln \"$f\" /dev/shm/mine 2>/dev/null && (: >/dev/shm/mine) 2>/dev/null && echo linked $f
    rm -f /dev/shm/mine
done";
const FILL: &str = "dd if=/dev/zero of=/dev/shm/full bs=64k 2>/dev/null; stat -c %s /dev/shm/full";

#[test]
#[ignore = "needs a /dev/shm of its own, which the other test makes"]
fn beside_user_nobody() {
    let run = RunDir::new();
    let daemon = Daemon::start(&run);
    daemon.wait_for("state: holding");
    let mut client = connect(&run, &daemon);

    // Writes, truncations, links.
    let names = as_nobody("cd /dev/shm && ls -d torqued*");
    assert!(names.lines().count() > 5, "{names}");
    assert_eq!(as_nobody(SPOIL), "");
    drop(connect(&run, &daemon));

    // No room: no new client, but a stop.
    let mut commander = Commander::connect(&mut client).expect("the lease");
    commander.hold_until_ready(PATIENCE).expect("followed");
    let ended = Mutex::new(String::new());
    as_nobody(FILL);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            // Goes on as long as it is followed.
            let q = commander.reference().joints[3].q_d;
            let until = Instant::now() + PATIENCE;
            while Instant::now() < until {
                let sent = commander.send(|reference| {
                    reference.mode = Mode::InverseDynamics.number();
                    reference.joints[3].q_d = q;
                });
                if let Err(why) = sent {
                    *ended.lock().expect("a text") = why.to_string();
                    return;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        daemon.wait_for("state: active");
        let location = Location::at(run.location.path()).expect("a run directory");
        let refused = Client::connect_at(&location, "leg", Duration::ZERO);
        let no_room = matches!(&refused, Err(Error::NoRoom { .. }));
        assert!(no_room, "{:?}", refused.err());
        let daemons = running_daemons(run.location.path()).expect("readable");
        let [found] = daemons.as_slice() else {
            panic!("{daemons:?}");
        };
        assert_eq!(found.robot, "leg");
        assert_eq!(found.pid, daemon.process.id() as i32);
        assert!(found.state().is_some_and(|state| state == "active"));
        found.stop_and_hold().expect("signalled");
        daemon.wait_for("SIGUSR1");
        let until = Instant::now() + PATIENCE;
        while found.state().as_deref() != Some("holding") {
            assert!(Instant::now() < until, "{:?}", found.state());
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    let ended = ended.into_inner().expect("a text");
    assert!(ended.contains("an operator's request"), "{ended:?}");
    drop(commander);
    drop(client);
    daemon.end();
    assert_eq!(running_daemons(run.location.path()).expect("readable"), []);

    // All names that were there are taken, as files and as links; then there is no room at all.
    let taken = format!(
        "rm -f /dev/shm/full; cd /dev/shm; for f in {}; do ln -s /etc/passwd $f 2>/dev/null
         done; ls -d torqued* | wc -l",
        names.replace('\n', " ")
    );
    let count = as_nobody(&taken);
    assert!(
        count.trim().parse::<usize>().is_ok_and(|count| count > 5),
        "{count}"
    );
    as_nobody(FILL);
    let daemon = Daemon::start(&run);
    daemon.wait_for("no client can connect yet");
    daemon.wait_for("state: holding");
    as_nobody("rm -f /dev/shm/full");
    daemon.wait_for("clients can connect");
    let mut client = connect(&run, &daemon);
    let record = client.next_record(PATIENCE).expect("a record");
    assert_eq!(record.cycle.state, RobotState::Holding.number());
    drop(client);

    // A daemon that was killed leaves its files: the next one takes them over.
    drop(daemon);
    let daemon = Daemon::start(&run);
    daemon.wait_for("state: holding");
    drop(connect(&run, &daemon));
    assert_eq!(as_nobody(SPOIL), "");
    daemon.end();
}

#[test]
fn another_user_keeps_neither_a_stop_nor_a_restart_from_happening() {
    let script = "mount -t tmpfs -o size=80m,mode=1777 tmpfs /dev/shm || exit 77
        exec \"$0\" --ignored --exact other_users::beside_user_nobody --nocapture";
    let out = Command::new("unshare")
        .args(["--mount", "sh", "-c", script])
        .arg(std::env::current_exe().expect("this test"))
        .output();
    let Ok(out) = out else {
        println!("skipped: no unshare here");
        return;
    };
    let text = [out.stdout, out.stderr].concat();
    let text = String::from_utf8_lossy(&text);
    if out.status.code() == Some(77) || text.contains("unshare failed") {
        println!(
            "skipped: only root makes a mount namespace in which there is another user: {text}"
        );
        return;
    }
    assert!(out.status.success(), "{text}");
    assert!(text.contains("1 passed"), "{text}");
}
