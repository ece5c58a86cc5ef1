//! `torqued run`: the loop on real buses, shared with other processes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use cycle::ClientInput;
use nix::sys::resource::{UsageWho, getrusage};
use robot_config::{RealTime, Robot};
use robot_state::{Description, Event, JointMeasured, Name, SharedRecord, measured_flags};

use crate::bus::{Line, OpenError, SocketCan};
use crate::control_loop::ControlLoop;
use crate::failure::Failure;
use crate::offsets::Store;
use crate::real_time::{self, Deadline, Pace, Settings};
use crate::request_server::RequestServer;
use crate::shared_memory::{self, LoopEnds};
use crate::summary::{PageFaults, Summary, Timing};

/// Interval at which the main thread polls the loop.
const LOOK: Duration = Duration::from_millis(100);
/// Polls between two messages about joints that have not answered.
const PATIENCE: u32 = 10;

/// Runs the robot until `stop` is set or `cycles` have begun or been skipped, and sums up.
///
/// # Errors
/// Whatever keeps the loop from starting: nothing has been sent then.
pub fn run(robot: &Robot, cycles: Option<u64>, stop: &Arc<AtomicBool>) -> Result<Summary, Failure> {
    let parameters = &robot.parameters;
    let lines: Vec<Line<'_>> = parameters.buses.iter().map(Line::from).collect();
    let bus = SocketCan::open(&lines).map_err(|error| match error {
        OpenError::Interfaces(_) => Failure::bad_input(error),
        OpenError::NoCan(_) | OpenError::Socket(..) => Failure::environment(error),
    })?;
    let control_loop = ControlLoop::new(robot, bus).map_err(Failure::bad_input)?;
    let server =
        RequestServer::new(robot, Store::find(&parameters.name)).map_err(Failure::bad_input)?;
    if !parameters.ft_sensors.is_empty() {
        eprintln!("{}", server.describe_tare());
    }
    let clients = shared_memory::start(&describe(robot), server).map_err(Failure::environment)?;
    let status = Arc::new(Status::default());
    let mut looper = Looper {
        control_loop,
        clients,
        timing: Timing::new(),
        status: Arc::clone(&status),
        stop: Arc::clone(stop),
        cycles: cycles.unwrap_or(u64::MAX),
        period_ns: (parameters.timing.sample_period * 1e9).round() as u64,
    };
    let settings = Settings {
        require: parameters.timing.real_time == RealTime::Require,
        priority: parameters.timing.priority,
        cpu: parameters.timing.cpu,
    };
    let loop_thread = thread::Builder::new()
        .name("loop".to_owned())
        .spawn(move || {
            let real_time = real_time::enter(&settings).map_err(Failure::environment)?;
            for measure in real_time.report.denied() {
                eprintln!("torqued: {measure}");
            }
            Ok(looper.run())
        });
    let loop_thread = loop_thread.map_err(Failure::environment)?;
    watch(robot, &status, || loop_thread.is_finished());
    let outcome = loop_thread
        .join()
        .map_err(|_| Failure::environment("the loop's thread panicked"))?;
    let (record, timing, page_faults, dropped) = outcome?;
    Ok(Summary::new(
        &parameters.name,
        &record,
        &timing,
        page_faults,
        dropped,
    ))
}

/// State of the loop that the main thread reads while it runs.
#[derive(Debug, Default)]
struct Status {
    cycles: AtomicU64,
    /// A bit for each joint that has never answered.
    silent: AtomicU64,
    fault: AtomicU32,
}

struct Looper {
    control_loop: ControlLoop<SocketCan>,
    clients: LoopEnds,
    timing: Timing,
    status: Arc<Status>,
    stop: Arc<AtomicBool>,
    cycles: u64,
    period_ns: u64,
}

impl Looper {
    fn run(&mut self) -> (SharedRecord, Timing, PageFaults, u64) {
        let mut last = SharedRecord::default();
        let mut deadline = Deadline::new(self.period_ns);
        let before = page_faults();
        // Skipped starts count too: `--seconds` means time.
        let mut starts = 0;
        while starts < self.cycles && !self.stop.load(Ordering::Relaxed) {
            let wake = deadline.wait();
            starts += 1 + wake.skipped;
            let arrived = self.clients.references.latest();
            let wanted = ClientInput {
                reference: arrived.map(|(reference, _)| reference),
                age_s: arrived.map_or(0.0, |(_, at)| wake.woke_ns.saturating_sub(at) as f64 * 1e-9),
                settings: Some(self.clients.settings.latest()),
                request: None,
            };
            let record = self.control_loop.run_cycle(&wake, &wanted);
            self.clients.records.send(record);
            self.timing.take(&record.timing);
            self.status.show(record);
            last = *record;
        }
        let after = page_faults();
        let faults = PageFaults {
            minor: after.minor - before.minor,
            major: after.major - before.major,
        };
        let dropped = self.clients.records.overflow();
        (last, std::mem::take(&mut self.timing), faults, dropped)
    }
}

impl Status {
    fn show(&self, record: &SharedRecord) {
        let joints = record
            .cycle
            .measured
            .joints
            .iter()
            .take(record.cycle.joint_count as usize);
        let never = |joint: &JointMeasured| joint.flags & measured_flags::NEVER != 0;
        let silent = joints.enumerate().filter(|(_, joint)| never(joint));
        let silent = silent.fold(0, |bits, (j, _)| bits | 1u64 << j);
        self.silent.store(silent, Ordering::Relaxed);
        self.fault.store(record.cycle.fault, Ordering::Relaxed);
        self.cycles.store(record.timing.cycles, Ordering::Release);
    }
}

/// Prints which joints the loop waits for and which fault it has latched, until it ends.
fn watch(robot: &Robot, status: &Status, ended: impl Fn() -> bool) {
    let (mut looks, mut running, mut fault) = (0, false, 0);
    while !ended() {
        thread::sleep(LOOK);
        looks += 1;
        let silent = status.silent.load(Ordering::Relaxed);
        if status.cycles.load(Ordering::Acquire) > 0 && silent == 0 && !running {
            running = true;
            eprintln!("running: every joint has answered");
            // Nobody may be waiting for it: then there is nothing to notify.
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
        }
        if silent != 0 && !running && looks % PATIENCE == 0 {
            eprintln!("waiting for {}", silent_joints(robot, silent));
        }
        let now = status.fault.load(Ordering::Relaxed);
        if now != fault {
            fault = now;
            match Event::from_number(now) {
                Some(event) => eprintln!("FAULT {} {}: {}", now, event.name(), event.cause()),
                None => eprintln!("fault reset"),
            }
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
                joint.name, bus.name, bus.interface
            )
        })
        .collect();
    format!(
        "{}; is the robot on? Next: candump, torquectl check",
        named.join(", ")
    )
}

fn describe(robot: &Robot) -> Description {
    let parameters = &robot.parameters;
    let mut description = Description {
        robot: Name::new(&parameters.name),
        rate_hz: 1.0 / parameters.timing.sample_period,
        joint_count: parameters.joints.len() as u32,
        ft_count: parameters.ft_sensors.len() as u32,
        ..Description::default()
    };
    for (j, joint) in parameters.joints.iter().enumerate() {
        description.joint_names[j] = Name::new(&joint.name);
        description.torque_limits[j] = joint.limits.torque;
    }
    for (i, name) in robot_config::contact_names(parameters).iter().enumerate() {
        description.contact_set_names[i] = Name::new(name);
        description.contact_set_count += 1;
    }
    for (s, ft) in parameters.ft_sensors.iter().enumerate() {
        description.ft_names[s] = Name::new(&ft.sensor.name);
    }
    description
}

/// Page faults of the calling thread so far.
fn page_faults() -> PageFaults {
    getrusage(UsageWho::RUSAGE_THREAD).map_or(PageFaults::default(), |usage| PageFaults {
        minor: usage.minor_page_faults().unsigned_abs(),
        major: usage.major_page_faults().unsigned_abs(),
    })
}
