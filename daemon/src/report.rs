//! The main thread's part while the loop runs: messages, and the latched fault kept on the disk.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use robot_config::Robot;
use robot_state::{Event, RobotState};

use crate::looper::Status;
use crate::service_manager::ServiceManager;
use crate::stored_fault::FaultStore;
use torqued_client::ProcessFile;

/// Interval between two messages about joints that have not answered.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time beyond the limits of the controlled end after which the main thread no longer waits for the
/// loop.
const GRACE: Duration = Duration::from_secs(2);

/// Watches the loop and reports its changes.
pub struct Reporter<'a> {
    robot: &'a Robot,
    store: Option<FaultStore>,
    manager: ServiceManager,
    running: bool,
    state: Option<RobotState>,
    fault: u32,
    /// Instants of the last message about missing joints, and of the request to end.
    named: Instant,
    end_asked: Option<Instant>,
    signalled_stops: u32,
    /// Where the state can be read without shared memory.
    process: Option<ProcessFile>,
}

impl<'a> Reporter<'a> {
    /// `store`: storage of a latched fault, if any; `fault`: the one stored there.
    #[must_use]
    pub fn new(robot: &'a Robot, store: Option<FaultStore>, fault: Option<Event>) -> Self {
        Self {
            robot,
            store,
            manager: ServiceManager::find(),
            running: false,
            state: None,
            fault: fault.map_or(0, Event::number),
            named: Instant::now(),
            end_asked: None,
            signalled_stops: 0,
            process: None,
        }
    }

    /// Shows the robot's state in this file too.
    #[must_use]
    pub fn show_in(mut self, process: ProcessFile) -> Self {
        self.process = Some(process);
        self
    }

    /// Looks at the loop's state; `false`: the loop does not reach the end that was requested.
    pub fn look(&mut self, status: &Status, stop: &AtomicBool) -> bool {
        let cycles = status.cycles.load(Ordering::Acquire);
        if cycles > 0 {
            let silent = status.silent.load(Ordering::Relaxed);
            self.report_joints(silent);
            self.report_signalled_stops(status.signalled_stops.load(Ordering::Relaxed));
            // Before the disk, which may take its time.
            let text = self.status(status, silent);
            self.manager.update(cycles, &text, Instant::now());
            if let Some(process) = &mut self.process {
                // A full disk: clients with shared memory still see the state.
                let _ = process.show(&text);
            }
            self.report_fault(status.fault.load(Ordering::Relaxed));
            self.report_state(RobotState::from_number(
                status.state.load(Ordering::Relaxed),
            ));
        }
        if stop.load(Ordering::Relaxed) && self.end_asked.is_none() {
            tracing::info!(
                "ending: the robot is brought to rest, then its drives are switched off"
            );
            self.end_asked = Some(Instant::now());
            self.manager.stopping();
        }
        let limit = Duration::from_secs_f64(self.robot.parameters.safety.time_limit) + GRACE;
        self.end_asked.is_none_or(|asked| asked.elapsed() < limit)
    }

    /// The robot's state in one line, for `systemctl status`.
    fn status(&self, status: &Status, silent: u64) -> String {
        let state = RobotState::from_number(status.state.load(Ordering::Relaxed));
        let state = state.map_or("unknown", RobotState::name);
        let number = status.fault.load(Ordering::Relaxed);
        match Event::from_number(number) {
            Some(event) => format!("{state} {number} {}: {}", event.name(), event.cause()),
            None if silent != 0 => format!("{state}: waiting for {} joints", silent.count_ones()),
            None => state.to_owned(),
        }
    }

    fn report_signalled_stops(&mut self, count: u32) {
        if count != self.signalled_stops {
            self.signalled_stops = count;
            tracing::info!("SIGUSR1: the robot is brought to rest and held");
        }
    }

    fn report_joints(&mut self, silent: u64) {
        if silent == 0 && !self.running {
            self.running = true;
            tracing::info!("running: every joint has answered");
        }
        if silent != 0 && !self.running && self.named.elapsed() > PATIENCE {
            self.named = Instant::now();
            tracing::warn!("waiting for {}", silent_joints(self.robot, silent));
        }
    }

    /// Reports a change of the latched fault, and stores it.
    pub fn report_fault(&mut self, number: u32) {
        if number == self.fault {
            return;
        }
        self.fault = number;
        let event = Event::from_number(number);
        match event {
            Some(event) => tracing::error!(
                event = number,
                "FAULT {number} {}: {}",
                event.name(),
                event.cause()
            ),
            None => tracing::info!("fault acknowledged"),
        }
        if let Some(Err(why)) = self.store.as_ref().map(|store| store.save(event)) {
            tracing::warn!("the latched fault will not be known after a restart: {why}");
        }
    }

    fn report_state(&mut self, state: Option<RobotState>) {
        if self.state != state {
            self.state = state;
            let state = state.map_or("unknown", RobotState::name);
            tracing::info!(state, "state: {state}");
        }
    }
}

/// The joints that have never answered, with what they should have sent.
fn silent_joints(robot: &Robot, silent: u64) -> String {
    let parameters = &robot.parameters;
    let joints = parameters.joints.iter().enumerate();
    let named: Vec<String> = joints
        .filter(|(j, _)| silent >> j & 1 == 1)
        .map(|(j, joint)| {
            let bus = &parameters.buses[joint.bus];
            let slot = robot_config::slots::link_angle(j);
            let receive = &robot.receive;
            let message = (0..receive.message_count())
                .find(|&m| receive.slots(m).any(|s| s == slot))
                .and_then(|m| receive.message(m));
            let message = message.map_or("its state", |m| &m.name);
            format!(
                "{} ({message} on {}, {})",
                joint.name, bus.name, bus.carrier
            )
        })
        .collect();
    format!(
        "{}; is the robot on? Next: candump, torquectl check",
        named.join(", ")
    )
}
