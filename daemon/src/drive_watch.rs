//! Watch over CANopen drives while the loop runs: a thread of its own, with sockets of its own.
//!
//! It names what drives tell besides their process data, and sets up anew what has started anew. The
//! loop withdraws such a joint by itself, because its process data end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use can_codec::{Frame, Frames, Gather, MAX_FRAMES, Table};
use drives::canopen::NodeState;
use drives::canopen::bring_up::{BringUp, Limits, Outcome, Plan};
use drives::canopen::emcy::Emergency;
use robot_config::Robot;

use crate::bring_up::{self, LOOK_NS};
use crate::bus::Waiting;
use crate::failure::Failure;

/// Longest wait for a frame while no drive is being set up, ns.
const IDLE_NS: u64 = 50_000_000;
/// Time from one set-up of a drive to the next, ns.
const AGAIN_NS: u64 = 5_000_000_000;

/// The watch; ends when it is dropped.
pub struct DriveWatch {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl DriveWatch {
    /// Begins on a bus of its own; none if the robot has no CANopen drives.
    ///
    /// # Errors
    /// Its bus or its thread cannot be made.
    pub fn start<B: Waiting + Send + 'static>(
        robot: &Robot,
        bus: impl FnOnce() -> Result<B, Failure>,
    ) -> Result<Option<Self>, Failure> {
        if robot.nodes.plans.is_empty() {
            return Ok(None);
        }
        let bus = bus()?;
        let mut watch = Watch {
            buses: bring_up::bus_names(robot),
            nodes: robot.nodes.plans.iter().map(Node::new).collect(),
            // No message of the robot is waited for here.
            table: robot.receive.clone(),
            bus,
        };
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::Builder::new()
            .name("drives".to_owned())
            .spawn(move || watch.run(&stopped))
            .map_err(Failure::environment)?;
        Ok(Some(Self {
            stop,
            thread: Some(thread),
        }))
    }
}

impl Drop for DriveWatch {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic there has been shown, and is no reason to end otherwise.
            let _ = thread.join();
        }
    }
}

/// A drive.
struct Node {
    plan: Plan,
    /// The set-up under way.
    set_up: Option<BringUp>,
    /// No set-up begins before, ns.
    not_before: u64,
    /// It is not operational, and is to be set up.
    lost: bool,
    /// Code of its last emergency.
    emergency: u16,
}

impl Node {
    fn new(plan: &Plan) -> Self {
        Self {
            plan: plan.clone(),
            set_up: None,
            not_before: 0,
            lost: false,
            emergency: 0,
        }
    }

    /// Shows an emergency, if it is this node's and another one than the last.
    fn complains(&mut self, bus: u8, emergency: Emergency) {
        let own = (bus, emergency.node) == (self.plan.bus, self.plan.node);
        if own && emergency.code != self.emergency {
            self.emergency = emergency.code;
            bring_up::show([&self.plan].into_iter(), bus, emergency);
        }
    }

    fn name(&self) -> String {
        format!("{} (node {})", self.plan.name, self.plan.node)
    }

    /// Takes a heartbeat or boot-up that comes while it is not set up.
    fn heard(&mut self, state: NodeState) {
        let what = match state {
            NodeState::Operational => return,
            _ if self.lost => return,
            NodeState::BootUp => "has started anew",
            NodeState::PreOperational | NodeState::Stopped => "has left operation by itself",
        };
        self.lost = true;
        let name = self.name();
        tracing::warn!(
            joint = name,
            "{name} {what}: its joint is withdrawn, and it is set up anew"
        );
    }
}

struct Watch<B> {
    bus: B,
    table: Table,
    buses: Vec<String>,
    nodes: Vec<Node>,
}

impl<B: Waiting> Watch<B> {
    fn run(&mut self, stop: &AtomicBool) {
        let (mut rx, mut tx) = (Frames::default(), Frames::default());
        let mut gather = Gather::only(&vec![false; self.table.message_count()]);
        let mut out = Vec::with_capacity(MAX_FRAMES);
        while !stop.load(Ordering::Relaxed) {
            let busy = self.nodes.iter().any(|node| node.set_up.is_some());
            let wait = if busy { LOOK_NS } else { IDLE_NS };
            let now = self.bus.now_ns();
            self.bus.wait(now + wait);
            rx.clear();
            gather.begin();
            self.bus.receive(&mut rx, &mut gather, &self.table, 0);
            let now = self.bus.now_ns();
            for frame in &rx {
                self.take(frame, now, &mut out);
            }
            for node in &mut self.nodes {
                go_on(node, now, &self.buses, &mut out);
            }
            bring_up::send(&mut self.bus, &mut tx, &mut out);
        }
    }

    fn take(&mut self, frame: &Frame, now: u64, out: &mut Vec<Frame>) {
        let emergency = Emergency::of(frame);
        for node in &mut self.nodes {
            if let Some(emergency) = emergency {
                node.complains(frame.bus, emergency);
            }
            if let Some(set_up) = &mut node.set_up {
                set_up.receive(frame, now, out);
            } else if let Some((id, state)) = NodeState::of(frame)
                && (frame.bus, id) == (node.plan.bus, node.plan.node)
            {
                node.heard(state);
            }
        }
    }
}

/// Begins, continues and ends a drive's set-up.
fn go_on(node: &mut Node, now: u64, buses: &[String], out: &mut Vec<Frame>) {
    if node.lost && node.set_up.is_none() && now >= node.not_before {
        node.lost = false;
        node.not_before = now + AGAIN_NS;
        node.set_up = Some(BringUp::new(node.plan.clone(), Limits::default()));
    }
    let Some(set_up) = &mut node.set_up else {
        return;
    };
    set_up.poll(now, out);
    match set_up.outcome() {
        Outcome::Working(_) => return,
        Outcome::Done => tracing::info!(
            "{} is set up anew, and off until the robot is enabled again",
            node.name()
        ),
        Outcome::Failed(trouble) => {
            let problem = bring_up::problem(trouble, buses);
            // It may have nothing more to say, as a reset ends its heartbeat.
            node.lost = true;
            tracing::warn!(
                "{problem}; tried again every {} s",
                AGAIN_NS / 1_000_000_000
            );
        }
    }
    node.set_up = None;
}
