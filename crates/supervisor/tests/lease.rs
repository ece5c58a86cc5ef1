//! The lease of the command under any course of references and silences, and the order in which
//! cycles see them. What must hold is stated about histories, not by a second lease.

use std::collections::HashMap;

use proptest::prelude::*;
use robot_state::{Mode, Reference, lease_refusal};
use supervisor::{Commanders, Lease, Verdict};

const TIMEOUT_NS: u64 = 40;

/// A step of a course: time passes, references arrive.
#[derive(Debug, Clone)]
enum Step {
    /// The time that passes until the next cycle, ns; silent holders lose the lease then.
    Cycle(u64),
    /// Any reference of one of a few sessions; times relative to the present, back in time.
    Any {
        session: u64,
        began_ago: u64,
        sequence: u64,
        sent_ago: i64,
        priority: u32,
        hold: bool,
        gives_back: bool,
    },
    /// A reference as a sound client sends it: the session's next, sent now.
    Sound {
        session: u64,
        hold: bool,
        gives_back: bool,
    },
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        (0..TIMEOUT_NS + 20).prop_map(Step::Cycle),
        (
            0..6_u64,
            0..300_u64,
            prop_oneof![0..20_u64, Just(u64::MAX)],
            -5..60_i64,
            0..3_u32,
            any::<bool>(),
            prop::bool::weighted(0.1),
        )
            .prop_map(
                |(session, began_ago, sequence, sent_ago, priority, hold, gives_back)| Step::Any {
                    session,
                    began_ago,
                    sequence,
                    sent_ago,
                    priority,
                    hold,
                    gives_back,
                }
            ),
        (1..6_u64, any::<bool>(), prop::bool::weighted(0.1)).prop_map(
            |(session, hold, gives_back)| Step::Sound {
                session,
                hold,
                gives_back,
            }
        ),
    ]
}

/// The part of a reference on which the lease depends.
#[derive(Debug, Clone, Copy)]
struct Bid {
    session: u64,
    began_ns: u64,
    sequence: u64,
    sent_ns: u64,
    priority: u32,
    pid: u32,
    asks_hold: bool,
    gives_back: bool,
}

impl Bid {
    fn reference(&self) -> Reference {
        let mode = if self.asks_hold {
            Mode::Hold
        } else {
            Mode::Torque
        };
        Reference {
            session: self.session,
            session_began_ns: self.began_ns,
            sequence: self.sequence,
            sent_ns: self.sent_ns,
            priority: self.priority,
            pid: self.pid,
            mode: mode.number(),
            gives_back: u32::from(self.gives_back),
            ..Reference::default()
        }
    }
}

/// State of a session by its references that were followed.
#[derive(Debug, Clone, Copy)]
struct Seen {
    began_ns: u64,
    sequence: u64,
    sent_ns: u64,
    priority: u32,
}

/// A session: its number, and when it began. The same number with another begin is another session.
type Id = (u64, u64);

fn id(bid: &Bid) -> Id {
    (bid.session, bid.began_ns)
}

/// The history of a course.
#[derive(Debug, Default)]
struct History {
    now_ns: u64,
    sound_sequence: HashMap<u64, u64>,
    /// Sessions whose references were followed, with the last one.
    followed: HashMap<Id, Seen>,
    /// Sessions that have lost the lease.
    over: Vec<Id>,
    holder: Option<Id>,
}

impl History {
    fn bid(&mut self, step: &Step) -> Option<Bid> {
        match *step {
            Step::Cycle(_) => None,
            Step::Any {
                session,
                began_ago,
                sequence,
                sent_ago,
                priority,
                hold,
                gives_back,
            } => Some(Bid {
                session,
                began_ns: self.now_ns.saturating_sub(began_ago),
                sequence,
                sent_ns: self.now_ns.saturating_add_signed(-sent_ago),
                priority,
                pid: session as u32,
                asks_hold: hold,
                gives_back,
            }),
            Step::Sound {
                session,
                hold,
                gives_back,
            } => {
                let sequence = self.sound_sequence.entry(session).or_insert(1000);
                *sequence += 1;
                Some(Bid {
                    session,
                    // In the order of their numbers.
                    began_ns: session,
                    sequence: *sequence,
                    sent_ns: self.now_ns,
                    priority: session as u32 % 3,
                    pid: session as u32,
                    asks_hold: hold,
                    gives_back,
                })
            }
        }
    }

    fn lose(&mut self) {
        if let Some(holder) = self.holder.take() {
            self.over.push(holder);
        }
    }

    /// Conditions if this bid is followed.
    fn check_followed(&mut self, bid: &Bid, verdict: Verdict) {
        let sent_ns = bid.sent_ns.min(self.now_ns);
        assert!(self.now_ns - sent_ns <= TIMEOUT_NS, "too old: {bid:?}");
        assert!(bid.session != 0 && bid.began_ns <= self.now_ns);
        assert!(!self.over.contains(&id(bid)), "came back: {bid:?}");
        match verdict {
            Verdict::Granted | Verdict::TakenOver => {
                assert!(bid.asks_hold, "not by hold: {bid:?}");
                let older = self.followed.values().all(|s| s.began_ns < bid.began_ns);
                assert!(older, "an older session: {bid:?}");
                let replaced = self.holder.and_then(|holder| self.followed.get(&holder));
                assert_eq!(replaced.is_some(), verdict == Verdict::TakenOver);
                assert!(replaced.is_none_or(|seen| bid.priority > seen.priority));
                self.lose();
                self.holder = Some(id(bid));
            }
            Verdict::Renewed | Verdict::GivenBack => {
                assert_eq!(self.holder, Some(id(bid)));
                let last = self.followed[&id(bid)];
                assert!(bid.sequence > last.sequence && sent_ns >= last.sent_ns);
            }
            Verdict::Refused(_) => unreachable!(),
        }
        let first = self.followed.get(&id(bid)).copied();
        let seen = Seen {
            sequence: bid.sequence,
            sent_ns,
            began_ns: bid.began_ns,
            priority: first.map_or(bid.priority, |seen| seen.priority),
        };
        self.followed.insert(id(bid), seen);
        if verdict == Verdict::GivenBack {
            self.lose();
        }
    }

    /// Condition if this bid is refused: a reason that is true.
    fn check_refused(&self, bid: &Bid, reason: u32) {
        let sent_ns = bid.sent_ns.min(self.now_ns);
        let last = self.followed.get(&id(bid));
        let holds = self.holder == Some(id(bid));
        let holder = self.holder.map(|holder| self.followed[&holder]);
        let youngest = self.followed.values().map(|seen| seen.began_ns).max();
        let true_reason = match reason {
            lease_refusal::INVALID => bid.session == 0 || bid.began_ns > sent_ns,
            lease_refusal::TOO_OLD => self.now_ns - sent_ns > TIMEOUT_NS,
            lease_refusal::NOT_ADVANCED => {
                holds && last.is_some_and(|l| bid.sequence <= l.sequence || sent_ns < l.sent_ns)
            }
            lease_refusal::HELD => !holds && holder.is_some_and(|h| bid.priority <= h.priority),
            lease_refusal::OLD_SESSION => {
                !holds && youngest.is_some_and(|began_ns| bid.began_ns <= began_ns)
            }
            lease_refusal::HOLD_FIRST => !holds && (!bid.asks_hold || bid.gives_back),
            _ => false,
        };
        assert!(true_reason, "reason {reason} of {bid:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn no_course_of_references_breaks_the_lease(course in prop::collection::vec(step(), 1..80)) {
        let mut lease = Lease::new(TIMEOUT_NS);
        let mut history = History { now_ns: 1_000, ..History::default() };
        for step in &course {
            if let Step::Cycle(pause) = step {
                history.now_ns += pause;
                let silent = history.holder.is_some_and(|holder| {
                    history.now_ns - history.followed[&holder].sent_ns > TIMEOUT_NS
                });
                prop_assert_eq!(lease.expire(history.now_ns), silent, "exactly when silent");
                if silent {
                    history.lose();
                }
            }
            let Some(bid) = history.bid(step) else { continue };
            match lease.offer(&bid.reference(), history.now_ns) {
                Verdict::Refused(reason) => history.check_refused(&bid, reason),
                verdict => history.check_followed(&bid, verdict),
            }
            let holder = lease.holder().map(|holder| (holder.session, holder.began_ns));
            prop_assert_eq!(holder, history.holder);
        }
        // Whatever was before: one time-out later a new session that asks for hold has the lease.
        history.now_ns += TIMEOUT_NS + 1;
        lease.expire(history.now_ns);
        let fresh = Bid {
            session: 99,
            began_ns: history.now_ns,
            sequence: 1,
            sent_ns: history.now_ns,
            priority: 0,
            pid: 99,
            asks_hold: true,
            gives_back: false,
        };
        prop_assert_eq!(lease.offer(&fresh.reference(), history.now_ns), Verdict::Granted);
    }

    /// Several references of several sessions in each cycle; the cycles see them in order.
    #[test]
    fn no_mode_is_seen_before_its_session_has_asked_for_hold(
        cycles in prop::collection::vec(
            prop::collection::vec((1..5_u64, 0..3_u32, prop::bool::weighted(0.05)), 0..6),
            1..60,
        ),
    ) {
        let mut commanders = Commanders::new(TIMEOUT_NS as f64 * 1e-9);
        let mut now_ns = 1_000;
        let mut sequence = 0;
        // The session that the cycles follow, and its references that were taken, not yet seen.
        let mut seen: Option<(u64, u64)> = None;
        let mut newest_taken: Option<(u64, u64, u32)> = None;
        for references in &cycles {
            now_ns += 7;
            for &(session, mode, gives_back) in references {
                sequence += 1;
                let reference = Reference {
                    session,
                    session_began_ns: session,
                    sequence,
                    sent_ns: now_ns,
                    mode,
                    priority: session as u32 % 2,
                    gives_back: u32::from(gives_back),
                    ..Reference::default()
                };
                match commanders.offer(&reference, now_ns) {
                    Verdict::Refused(_) => {}
                    Verdict::GivenBack => newest_taken = Some((session, sequence, 0)),
                    _ => newest_taken = Some((session, sequence, mode)),
                }
            }
            // Two cycles: the second sees what waited in the first.
            for _ in 0..2 {
                commanders.begin_cycle(now_ns);
                let Some(reference) = commanders.reference() else {
                    continue;
                };
                let is_hold = reference.mode == Mode::Hold.number();
                if let Some((session, last)) = seen.filter(|(s, _)| *s == reference.session) {
                    prop_assert!(reference.sequence >= last, "session {} goes back", session);
                } else {
                    prop_assert!(is_hold, "session {} begins with a mode", reference.session);
                }
                seen = Some((reference.session, reference.sequence));
            }
            if let Some(reference) = commanders.reference() {
                let newest = (reference.session, reference.sequence, reference.mode);
                prop_assert_eq!(Some(newest), newest_taken, "the newest is seen in the end");
            }
        }
    }
}

fn reference(session: u64, sequence: u64, mode: Mode, sent_ns: u64) -> Reference {
    Reference {
        session,
        session_began_ns: session,
        sequence,
        sent_ns,
        mode: mode.number(),
        ..Reference::default()
    }
}

#[test]
fn hold_and_then_a_mode_within_one_cycle_are_both_seen() {
    let mut commanders = Commanders::new(0.04);
    let see = |commanders: &mut Commanders| {
        commanders.begin_cycle(1000);
        commanders.reference().map(|r| (r.sequence, r.mode))
    };
    commanders.offer(&reference(1, 1, Mode::Hold, 1000), 1000);
    commanders.offer(&reference(1, 2, Mode::Torque, 1000), 1000);
    commanders.offer(&reference(1, 3, Mode::Torque, 1000), 1000);
    assert_eq!(see(&mut commanders), Some((1, Mode::Hold.number())));
    assert_eq!(see(&mut commanders), Some((3, Mode::Torque.number())));
    assert_eq!(see(&mut commanders), Some((3, Mode::Torque.number())));
    // Also where the robot was taken from the client meanwhile.
    commanders.offer(&reference(1, 4, Mode::Hold, 1000), 1000);
    commanders.offer(&reference(1, 5, Mode::Torque, 1000), 1000);
    assert_eq!(see(&mut commanders), Some((4, Mode::Hold.number())));
    assert_eq!(see(&mut commanders), Some((5, Mode::Torque.number())));
}

#[test]
fn a_silent_commander_is_noticed_in_the_first_cycle_after_the_time_out() {
    let mut commanders = Commanders::new(0.04);
    commanders.offer(&reference(1, 1, Mode::Hold, 1_000_000), 1_000_000);
    for ms in 1..=41 {
        commanders.begin_cycle(ms * 1_000_000);
        assert!(commanders.reference().is_some(), "{ms} ms");
    }
    assert_eq!(commanders.record().session, 1);
    commanders.begin_cycle(42_000_000);
    assert!(commanders.reference().is_none());
    assert_eq!(commanders.record().session, 0);
    let again = reference(1, 2, Mode::Hold, 43_000_000);
    assert_eq!(
        commanders.offer(&again, 43_000_000),
        Verdict::Refused(lease_refusal::OLD_SESSION)
    );
}
