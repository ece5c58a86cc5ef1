//! Requests and answers: several clients at once, garbage, daemons that go.

use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use crate::common::{RunDir, connect, description};
use torqued_client::robot_state::{Answer, Text, answer_status, request};
use torqued_client::{Client, DaemonPorts, Error};

/// A daemon's end that answers `count` requests, each after two others of somebody else.
fn serve(ports: &DaemonPorts, count: usize, reply: impl Fn(&str) -> Answer) {
    let until = Instant::now() + Duration::from_secs(10);
    let mut served = 0;
    while served < count {
        assert!(Instant::now() < until, "only {served} requests came");
        ports.cleanup_dead_clients();
        let Some(asked) = ports.next_request().expect("received") else {
            sleep(Duration::from_millis(1));
            continue;
        };
        served += 1;
        for stranger in [asked.id.wrapping_add(1), 0] {
            let answer = Answer {
                id: stranger,
                status: answer_status::REFUSED,
                ..Answer::default()
            };
            ports.answer(&answer).expect("answered");
        }
        let mut answer = reply(asked.contact_set.as_str());
        answer.id = asked.id;
        ports.answer(&answer).expect("answered");
    }
}

fn done(contacts: &str) -> Answer {
    Answer {
        status: answer_status::DONE,
        text: Text::new(&format!("tared {contacts}")),
        ..Answer::default()
    }
}

#[test]
fn each_client_gets_its_own_answer() {
    const CLIENTS: usize = 6;
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let clients: Vec<Client> = (0..CLIENTS).map(|_| connect(&dir, &ports, "leg")).collect();
    scope(|threads| {
        for (i, client) in clients.iter().enumerate() {
            threads.spawn(move || {
                for round in 0..5 {
                    let set = format!("set {i} {round}");
                    let answer = client.tare(&set).expect("answered");
                    assert_eq!(answer.text.as_str(), format!("tared {set}"));
                }
            });
        }
        serve(&ports, 5 * CLIENTS, done);
    });
}

#[test]
fn refusals_are_errors_with_their_reason_and_progress_is_seen() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let client = connect(&dir, &ports, "leg");
    scope(|threads| {
        threads.spawn(|| {
            serve(&ports, 1, |_| Answer {
                status: answer_status::REFUSED,
                text: Text::new("the robot moves"),
                ..Answer::default()
            });
        });
        let refused = client.choose_contact_set("standing");
        let reason = "the robot moves".to_owned();
        assert_eq!(refused.err(), Some(Error::Refused { reason }));
    });
    scope(|threads| {
        threads.spawn(|| {
            let asked = loop {
                ports.cleanup_dead_clients();
                if let Some(asked) = ports.next_request().expect("received") {
                    break asked;
                }
            };
            for progress in [0.1, 0.5] {
                let working = Answer {
                    id: asked.id,
                    status: answer_status::WORKING,
                    progress,
                    ..Answer::default()
                };
                ports.answer(&working).expect("answered");
            }
            let mut last = done("");
            last.id = asked.id;
            ports.answer(&last).expect("answered");
        });
        let mut seen = Vec::new();
        client
            .request(request::TARE, "air", |answer| seen.push(answer.progress))
            .expect("done");
        assert_eq!(seen, [0.1, 0.5]);
    });
}

#[test]
fn silence_is_noticed_and_so_is_a_daemon_that_has_gone() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let client = connect(&dir, &ports, "leg");
    let error = client.forget_tare().expect_err("no answer");
    assert!(matches!(error, Error::Unanswered { .. }), "{error}");
    drop(ports);
    let error = client.last_tare().expect_err("no receiver");
    assert!(
        matches!(error, Error::Gone { .. } | Error::NoDaemon { .. }),
        "{error}"
    );
}

#[test]
fn refused_requests_do_not_hinder_others() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let (one, other) = (connect(&dir, &ports, "leg"), connect(&dir, &ports, "leg"));
    scope(|threads| {
        let flood = threads.spawn(|| {
            for _ in 0..3 {
                let refused = one.request(77, "no such kind", |_| ());
                assert!(matches!(refused, Err(Error::Refused { .. })));
            }
        });
        let polite = threads.spawn(|| other.tare("air").expect("answered"));
        serve(&ports, 4, |contacts| match contacts {
            "air" => done(contacts),
            _ => Answer {
                status: answer_status::REFUSED,
                ..Answer::default()
            },
        });
        flood.join().expect("refused");
        polite.join().expect("served");
    });
}
