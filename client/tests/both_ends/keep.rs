//! A lease that a thread keeps while the program computes.

use super::common::{RunDir, connect, description, while_led};
use std::thread::sleep;
use std::time::Duration;
use torqued_client::robot_state::{Mode, Reference};
use torqued_client::{Commander, DaemonPorts, Error, LONGEST_BUSY, Meanwhile};

/// Silence after which the daemon gives the lease to others, s: longer than a busy machine lets a thread wait.
const TIMEOUT_S: f64 = 0.4;
/// A computation that takes much longer.
const COMPUTES: Duration = Duration::from_millis(700);
/// The angle that the program asks for after its computation, rad: at 1 rad/s it is not reached meanwhile.
const COUNTS: f64 = 1e3;

/// The references that the daemon followed while a program led joint 0 at 1 rad/s, computed and went on.
fn followed(busy: Duration, meanwhile: Meanwhile) -> (Result<(), Error>, Vec<Reference>) {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    while_led(
        &ports,
        TIMEOUT_S,
        |_| {},
        || {
            let commander = Commander::connect(&mut client).expect("commander");
            let kept = commander.keep(busy, meanwhile).expect("a thread");
            let lead = |r: &mut Reference| {
                r.mode = Mode::InverseDynamics.number();
                (r.joints[0].q_d, r.joints[0].dq_d) = (0.0, 1.0);
            };
            kept.send(lead).expect("sent");
            sleep(COMPUTES);
            // The daemon sees the newest at each of its cycles, which a busy machine keeps waiting.
            for _ in 0..50 {
                kept.send(|r| r.joints[0].q_d = COUNTS)?;
                sleep(Duration::from_millis(2));
            }
            Ok(())
        },
    )
}

/// From the sending of `first` to that of `later`, s.
fn seconds(first: &Reference, later: &Reference) -> f64 {
    (later.sent_ns - first.sent_ns) as f64 * 1e-9
}

#[test]
fn a_program_that_computes_keeps_the_command_and_its_motion_goes_on() {
    let (again, followed) = followed(LONGEST_BUSY, Meanwhile::Extrapolate);
    again.expect("it still commands");
    let session = followed[0].session;
    assert!(
        followed
            .iter()
            .all(|reference| reference.session == session),
        "one session"
    );
    let led: Vec<_> = followed
        .iter()
        .filter(|r| r.mode == Mode::InverseDynamics.number())
        .collect();
    let went_on = led.iter().filter(|r| r.joints[0].q_d < COUNTS);
    for reference in went_on.clone() {
        let (q, after) = (reference.joints[0].q_d, seconds(led[0], reference));
        assert!(
            (q - after).abs() < 0.5,
            "{q} rad after {after} s at 1 rad/s"
        );
    }
    let furthest = went_on.map(|r| r.joints[0].q_d).fold(0.0, f64::max);
    assert!(furthest > 0.4, "went on for 0.7 s at 1 rad/s: {furthest}");
    let counts = led.iter().any(|r| r.joints[0].q_d == COUNTS);
    assert!(counts, "the program's own reference counts again");
}

#[test]
fn a_program_may_have_the_robot_hold_meanwhile() {
    let (again, followed) = followed(LONGEST_BUSY, Meanwhile::Hold);
    again.expect("it still commands");
    let session = followed[0].session;
    assert!(
        followed
            .iter()
            .all(|reference| reference.session == session),
        "one session"
    );
    let modes: Vec<u32> = followed.iter().map(|r| r.mode).collect();
    let led = modes
        .iter()
        .position(|mode| *mode == Mode::InverseDynamics.number())
        .expect("led");
    assert!(
        modes[led..].contains(&Mode::Hold.number()),
        "held while it computed"
    );
    let again = Mode::InverseDynamics.number();
    let counts = (followed.iter()).any(|r| r.mode == again && r.joints[0].q_d == COUNTS);
    assert!(counts, "led again");
}

#[test]
fn a_program_that_hangs_loses_the_command() {
    let (again, followed) = followed(Duration::from_millis(100), Meanwhile::Extrapolate);
    assert!(matches!(again, Err(Error::CommandLost { .. })), "{again:?}");
    let furthest = followed.iter().map(|r| r.joints[0].q_d).fold(0.0, f64::max);
    assert!(furthest <= 0.1, "no longer than it may: {furthest}");
}
