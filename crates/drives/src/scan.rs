//! Who is on a bus: by listening, then by questions that cannot move anything.
//!
//! Some questions of one family are commands of another: an ODrive takes CANopen's requests to some nodes as
//! its own targets. So the scan listens first, and no question leaves under an identifier of an ODrive
//! that was heard. CubeMars actuators know no question but a command, and are not asked.

mod dialogue;

use crate::canopen::{EMCY_ID, NODES, NodeState, SDO_REQUEST_ID};
use crate::family::{Address, FAMILIES, Family, Identity, State};
use can_codec::{EXTENDED_ID, Frame};
use dialogue::Dialogue;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Time of listening: heartbeats come at least once a second.
const LISTEN_NS: u64 = 1_200_000_000;
/// From one question to the next: a tenth of a bus of 1 Mbit/s.
const PACE_NS: u64 = 1_000_000;
/// Wait after the last question.
const WAIT_NS: u64 = 500_000_000;
/// Heartbeats of an ODrive before it counts as one.
const HEARTBEATS: u32 = 2;
/// Identifier that all ODrives take as a command, and all Damiao as a question.
const EVERYBODY: u32 = 0x7FF;

/// A device that was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// Index of the bus.
    pub bus: u8,
    /// Its identifier.
    pub node: u8,
    /// Its family, as `profile` names it; `canopen`: no drive.
    pub family: &'static str,
    /// The identifier to which it answers, where that can be set.
    pub reply: Option<u16>,
    /// State in words; none: it does not tell.
    pub state: Option<&'static str>,
    /// It makes torque, or may; none: it does not tell.
    pub is_on: Option<bool>,
    /// Its error in words; none: no error.
    pub error: Option<String>,
    /// What else it tells: names and values with units.
    pub facts: Vec<(&'static str, String)>,
}

/// A bus to be scanned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusToScan {
    /// Its index.
    pub bus: u8,
    /// It carries CAN FD.
    pub fd: bool,
}

/// What is to be asked.
enum Question {
    Frame(Frame),
    /// Node of CANopen.
    Node(u8),
}

/// The scan of one bus.
pub struct Scan {
    of: BusToScan,
    /// Only this identifier; none: all.
    only: Option<u8>,
    begin: Option<u64>,
    asking: bool,
    questions: VecDeque<Question>,
    next_ns: u64,
    dialogues: Vec<Dialogue>,
    /// ODrives that were heard, and how often.
    odrives: BTreeMap<u8, (u32, Identity)>,
    heard: BTreeMap<u8, NodeState>,
    found: BTreeMap<(&'static str, u8), Found>,
    skipped: BTreeSet<u8>,
    done: bool,
}

impl Scan {
    /// Of a bus; `only`: that identifier alone.
    #[must_use]
    pub fn new(of: BusToScan, only: Option<u8>) -> Self {
        Self {
            of,
            only,
            begin: None,
            asking: false,
            questions: VecDeque::new(),
            next_ns: 0,
            dialogues: Vec::new(),
            odrives: BTreeMap::new(),
            heard: BTreeMap::new(),
            found: BTreeMap::new(),
            skipped: BTreeSet::new(),
            done: false,
        }
    }

    /// It is over.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// ODrives for whose sake something was not asked.
    #[must_use]
    pub fn skipped(&self) -> Vec<u8> {
        self.skipped.iter().copied().collect()
    }

    /// What was found, by family and identifier.
    #[must_use]
    pub fn found(&self) -> Vec<Found> {
        let mut all = self.found.clone();
        // What was taken for an ODrive's heartbeat may be a node's process data.
        let of_node = |id: u32| {
            let nodes = self.found.values().filter(|f| is_canopen(f.family));
            let bases = [EMCY_ID, 0x180, 0x280, 0x380, 0x480];
            nodes
                .flat_map(|f| bases.map(|base| base + u32::from(f.node)))
                .any(|own| own == id)
        };
        for (node, (heartbeats, identity)) in &self.odrives {
            let wanted = self.only.is_none_or(|only| only == *node);
            if wanted && *heartbeats >= HEARTBEATS && !of_node(u32::from(*node) << 5 | 1) {
                let mut made = Found {
                    bus: self.of.bus,
                    node: *node,
                    family: "odrive",
                    ..Found::default()
                };
                note(&mut made, family("odrive"), identity);
                all.insert(("odrive", *node), made);
            }
        }
        for (node, state) in &self.heard {
            let known = all.keys().any(|(f, n)| is_canopen(f) && n == node);
            let wanted = self.only.is_none_or(|only| only == *node);
            if !known && wanted {
                let facts = vec![
                    ("network", state.name().to_owned()),
                    ("sdo", "no answer".to_owned()),
                ];
                let made = Found {
                    bus: self.of.bus,
                    node: *node,
                    family: "canopen",
                    facts,
                    ..Found::default()
                };
                all.insert(("canopen", *node), made);
            }
        }
        all.into_values().collect()
    }

    /// Goes on as far as time allows; frames to send are appended to `out`.
    pub fn poll(&mut self, now: u64, out: &mut Vec<Frame>) {
        let begin = *self.begin.get_or_insert(now);
        if now < begin + LISTEN_NS || self.done {
            return;
        }
        if !self.asking {
            self.asking = true;
            self.ask_all();
        }
        if now >= self.next_ns {
            match self.questions.pop_front() {
                Some(Question::Frame(frame)) => out.push(frame),
                Some(Question::Node(node)) => {
                    self.dialogues
                        .push(Dialogue::begin(self.of.bus, node, now, out));
                }
                None => {
                    self.done = self.dialogues.is_empty() && now >= self.next_ns + WAIT_NS;
                    self.poll_dialogues(now, out);
                    return;
                }
            }
            self.next_ns = now + PACE_NS;
        }
        self.poll_dialogues(now, out);
    }

    fn poll_dialogues(&mut self, now: u64, out: &mut Vec<Frame>) {
        for dialogue in &mut self.dialogues {
            dialogue.poll(now, out);
        }
        let over = self.dialogues.extract_if(.., |dialogue| dialogue.is_over());
        for found in over.filter_map(Dialogue::found).collect::<Vec<_>>() {
            let network = self.heard.get(&found.node).map(|state| state.name());
            let mut found = found;
            found
                .facts
                .extend(network.map(|name| ("network", name.to_owned())));
            self.found.insert((found.family, found.node), found);
        }
    }

    /// Takes a frame of the bus.
    pub fn receive(&mut self, frame: &Frame, now: u64, out: &mut Vec<Frame>) {
        if frame.bus != self.of.bus || frame.error {
            return;
        }
        if let Some((node, state)) = NodeState::of(frame) {
            self.heard.insert(node, state);
        }
        if !self.asking {
            if let Some(identity) = family("odrive").identify(frame) {
                let heard = self.odrives.entry(identity.node).or_default();
                *heard = (heard.0 + 1, identity);
            }
            return;
        }
        for dialogue in &mut self.dialogues {
            dialogue.receive(frame, now, out);
        }
        for family in FAMILIES {
            if family.name() == "odrive" || self.questions_of(family, 1).is_empty() {
                continue;
            }
            if let Some(identity) = family.identify(frame) {
                self.identified(family, &identity);
                break;
            }
        }
    }

    fn identified(&mut self, family: &'static dyn Family, identity: &Identity) {
        let node = identity.node;
        if self.only.is_some_and(|only| only != node) {
            return;
        }
        let key = (family.name(), node);
        let is_new = !self.found.contains_key(&key);
        let found = self.found.entry(key).or_insert_with(|| Found {
            bus: self.of.bus,
            node,
            family: family.name(),
            ..Found::default()
        });
        note(found, family, identity);
        if is_new {
            let more = self.questions_of(family, node).into_iter().skip(1);
            let more: Vec<_> = more.filter(|frame| self.is_harmless(frame.id)).collect();
            self.questions.extend(more.into_iter().map(Question::Frame));
        }
    }

    fn questions_of(&self, family: &dyn Family, node: u8) -> Vec<Frame> {
        let master = family.usual_reply(node);
        family.questions(Address {
            bus: self.of.bus,
            node,
            master,
        })
    }

    fn ask_all(&mut self) {
        let asked = |node: &u8| self.only.is_none_or(|only| only == *node);
        let nodes: Vec<u8> = NODES.filter(asked).collect();
        let mut questions = Vec::new();
        for family in FAMILIES.into_iter().filter(|f| self.of.fd || !f.needs_fd()) {
            for node in nodes.iter().filter(|node| family.nodes().contains(*node)) {
                let first = self.questions_of(family, *node).into_iter().next();
                questions.extend(first.map(|frame| (frame.id, Question::Frame(frame))));
            }
        }
        let of_canopen = nodes
            .iter()
            .map(|&node| (SDO_REQUEST_ID + u32::from(node), Question::Node(node)));
        questions.extend(of_canopen);
        for (id, question) in questions {
            if self.is_harmless(id) {
                self.questions.push_back(question);
            }
        }
    }

    /// No ODrive takes it as a command.
    fn is_harmless(&mut self, id: u32) -> bool {
        if id & EXTENDED_ID != 0 {
            return true;
        }
        let own = |node: &u8| id == EVERYBODY || id >> 5 == u32::from(*node);
        let taken = self.odrives.keys().copied().find(own);
        self.skipped.extend(taken);
        taken.is_none()
    }
}

fn is_canopen(family: &str) -> bool {
    matches!(family, "canopen" | "cia402")
}

fn family(name: &str) -> &'static dyn Family {
    let found = FAMILIES.into_iter().find(|family| family.name() == name);
    found.unwrap_or(FAMILIES[0])
}

/// Adds what an actuator has reported to what is known of it.
fn note(found: &mut Found, family: &dyn Family, identity: &Identity) {
    found.reply = identity.reply.or(found.reply);
    if let Some(state) = identity.state {
        found.state = Some(match state {
            State::Off => "off",
            State::Enabled => "enabled",
            State::Fault => "fault",
            State::Busy => "busy with something of its own",
        });
        found.is_on = Some(matches!(state, State::Enabled | State::Busy));
    }
    if let Some(error) = identity.error {
        let text = || format!("{error:#x}: {}", family.error_text(error));
        found.error = (error != 0).then(text);
    }
    for (name, value) in &identity.facts {
        found.facts.retain(|(known, _)| known != name);
        found.facts.push((name, value.clone()));
    }
}
