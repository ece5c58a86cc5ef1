//! `torqued run`: the loop on real buses or with a simulated robot, shared with other processes.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use plant::CanRobot;
use problem::Problem;
use recording::{AttachedFile, Header, Start};
use robot_config::{RealTime, Robot};
use robot_state::{Description, Event, Name};
use supervisor::Commanders;

use crate::actuator_watch::ActuatorWatch;
use crate::bring_up;
use crate::bus::in_process::{SimulatedDeadline, VirtualClock};
use crate::bus::{Bus, LockStep, Network};
use crate::bus_lock::BusLocks;
use crate::changed_files::ChangedFiles;
use crate::control_loop::ControlLoop;
use crate::cycle_times::{self, Book, LoopThread};
use crate::drive_watch::DriveWatch;
use crate::failure::Failure;
use crate::looper::Looper;
use crate::offsets::Store;
use crate::real_time::{self, Deadline, Pace, Settings};
use crate::recorder::{self, Always, BlackBoxes, Contents, RecorderHandle, RecordingRequest};
use crate::report::Reporter;
use crate::request_server::RequestServer;
use crate::shared_memory;
use crate::stored_fault::FaultStore;
use crate::summary::{Summary, Timing};
use torqued_client::{Location, ProcessFile, StateDirectory, TimingFile};

/// Behind a robot's name in the state directory: the simulated one's.
const SIMULATED: &str = "-simulated";
/// Interval at which the main thread looks at the loop.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time in which the recorder writes nothing of what is left after the loop's end.
const RECORDER_LIMIT: Duration = Duration::from_secs(10);

/// Options of a run, besides its robot.
#[derive(Debug, Default)]
pub struct RunOptions {
    /// Cycles after which it ends; none: it runs until it is stopped.
    pub cycles: Option<u64>,
    /// The configuration's files, for recordings and black boxes.
    pub files: Vec<AttachedFile>,
    /// A recording from the first cycle on.
    pub record: Option<(PathBuf, Contents)>,
    /// Set from outside, e.g. by a signal: the robot is brought to rest and held. Taken back by the
    /// loop.
    pub stop_and_hold: Arc<AtomicBool>,
}

/// Runs the robot on its buses until `stop` is set or `options.cycles` have begun or been skipped,
/// and sums up.
///
/// # Errors
/// Obstacles to the loop's start: nothing has been sent then. A loop that does not end.
pub fn run(robot: &Robot, options: RunOptions, stop: &Arc<AtomicBool>) -> Result<Summary, Failure> {
    let buses = &robot.parameters.buses;
    let mut bus = Network::open(buses)?;
    let _locks =
        BusLocks::take(buses.iter().map(|bus| &bus.carrier)).map_err(Failure::environment)?;
    bring_up::bring_up(robot, &mut bus, stop)?;
    let reports = bus.translate(&robot.nodes.actuators);
    let reports = reports.map_err(Failure::bad_input)?;
    let _watch = DriveWatch::start(robot, || {
        let mut bus = Network::open(buses)?;
        bus.hear_only_nodes()?;
        Ok(bus)
    })?;
    let _actuators = ActuatorWatch::start(robot, reports)?;
    let state = &robot.parameters.name;
    run_on(robot, bus, Deadline::new, state, options, stop)
}

/// As [`run`], with a simulated robot in the loop's thread. Its tares and faults are kept apart from
/// those of the real robot.
///
/// # Errors
/// As [`run`].
pub fn simulate(
    robot: &Robot,
    plant: CanRobot,
    options: RunOptions,
    stop: &Arc<AtomicBool>,
) -> Result<Summary, Failure> {
    let clock = VirtualClock::new();
    let mut bus = LockStep::new(plant, &clock);
    bring_up::bring_up(robot, &mut bus, stop)?;
    let reports = bus.translate(&robot.nodes.actuators);
    let reports = reports.map_err(Failure::bad_input)?;
    let listener = bus.listener();
    let _watch = DriveWatch::start(robot, || Ok(listener))?;
    let _actuators = ActuatorWatch::start(robot, reports)?;
    let pace = move |period_ns| SimulatedDeadline::new(&clock, period_ns);
    let state = format!("{}{SIMULATED}", robot.parameters.name);
    run_on(robot, bus, pace, &state, options, stop)
}

/// Runs the robot; `pace`: makes the cycle's starts from its period, ns; `state`: the robot's folder
/// in the state directory.
fn run_on<B: Bus + Send + 'static, P: Pace>(
    robot: &Robot,
    bus: B,
    pace: impl FnOnce(u64) -> P + Send + 'static,
    state: &str,
    options: RunOptions,
    stop: &Arc<AtomicBool>,
) -> Result<Summary, Failure> {
    let parameters = &robot.parameters;
    let location = Location::find().map_err(Failure::environment)?;
    let process = ProcessFile::create(&location, &parameters.name).map_err(Failure::environment)?;
    if let Some(cpu) = parameters.timing.cpu
        && let Err(why) = real_time::keep_off_cpu(cpu)
    {
        tracing::warn!("publisher and recorder may run on the loop's CPU {cpu}: {why}");
    }
    let mut control_loop = ControlLoop::new(robot, bus).map_err(Failure::bad_input)?;
    let (store, fault) = stored_fault(state)?;
    if let Some(event) = fault {
        control_loop.start_with_fault(event);
    }
    let mut server = RequestServer::new(robot, Store::find(state)).map_err(Failure::bad_input)?;
    if !parameters.ft_sensors.is_empty() {
        tracing::info!("{}", server.describe_tare());
    }
    let start = Start {
        fault,
        unix_offset_ns: unix_offset_ns(control_loop.bus().now_ns()),
    };
    let mut files = ChangedFiles::new(&options.files);
    let header = Header::new(robot, options.files, start);
    let boxes = store
        .as_ref()
        .map(|store| BlackBoxes::new(store.directory()));
    let recorder = recorder::create(robot, header, boxes);
    control_loop.record_to(recorder.tap);
    let (times, receiver) = cycle_times::channel();
    control_loop.time_by(times);
    let thread = LoopThread::default();
    let file = TimingFile::of(location.path(), &parameters.name);
    let mut book = Book::new(robot, receiver, thread.clone(), Some(file));
    let handle = recorder.handle;
    server.record_with(handle.clone());
    if let Some((path, contents)) = options.record {
        record_from_the_start(&handle, path, contents);
    }
    let mut recorder = recorder.recorder;
    if let (Some(settings), Some(store)) = (parameters.recorder, &store) {
        let period_s = parameters.timing.sample_period;
        let always = Always::new(store.directory(), settings, period_s);
        recorder.record_always(always.map_err(Failure::bad_input)?);
    }
    let recorder = recorder.start().map_err(Failure::environment)?;
    let commanders = Commanders::new(parameters.timing.reference_timeout)
        .with_trajectories(parameters.trajectory_limits());
    let clients = shared_memory::start_at(&location, &describe(robot), server, commanders)
        .map_err(Failure::environment)?;
    let mut looper = Looper::new(robot, control_loop, clients, stop, options.cycles);
    looper.stop_and_hold_when(&options.stop_and_hold);
    let status = looper.status();
    let settings = Settings {
        require: parameters.timing.real_time == RealTime::Require,
        priority: parameters.timing.priority,
        cpu: parameters.timing.cpu,
    };
    let period_ns = (parameters.timing.sample_period * 1e9).round() as u64;
    let mut timing = Timing::new();
    let loop_thread = thread::Builder::new()
        .name("loop".to_owned())
        .spawn(move || {
            let real_time = real_time::enter(&settings).map_err(Failure::environment)?;
            thread.is_this_one();
            for measure in real_time.report.denied() {
                tracing::warn!("{measure}");
            }
            let outcome = looper.run(&mut pace(period_ns), &mut timing);
            Ok::<_, Failure>((outcome, timing))
        });
    let loop_thread = loop_thread.map_err(Failure::environment)?;
    let mut reporter = Reporter::new(robot, store, fault).show_in(process);
    while !loop_thread.is_finished() {
        thread::sleep(LOOK);
        book.look();
        for change in files.look() {
            tracing::warn!("{change}");
        }
        if !reporter.look(&status, stop) {
            return Err(Failure::environment(
                "the loop does not end: no longer waited for, drives may still be on",
            ));
        }
    }
    let joined = loop_thread.join();
    wait_for(&recorder, &handle);
    let Ok(outcome) = joined else {
        reporter.report_fault(Event::LoopEnded.number());
        return Err(Failure::environment("the loop's thread panicked"));
    };
    // A fault of the last cycles, too, is kept.
    reporter.look(&status, stop);
    let (outcome, timing) = outcome?;
    Ok(Summary::new(
        &parameters.name,
        &outcome.record,
        &timing,
        outcome.page_faults,
        outcome.dropped,
    ))
}

/// A recording that ends with the daemon.
fn record_from_the_start(handle: &RecorderHandle, path: PathBuf, contents: Contents) {
    handle.ask(RecordingRequest::Begin {
        path,
        seconds: None,
        last_s: 0.0,
        contents,
        overwrite: false,
        unattended: true,
    });
}

/// Difference of Unix time and the bus's time, ns.
pub(crate) fn unix_offset_ns(bus_ns: u64) -> i64 {
    let unix = SystemTime::now().duration_since(UNIX_EPOCH);
    let unix_ns = unix.map_or(0, |unix| unix.as_nanos() as i64);
    unix_ns.saturating_sub_unsigned(bus_ns)
}

/// Waits until black boxes and recordings are on the disk, but not for a disk that hangs.
fn wait_for(recorder: &JoinHandle<()>, handle: &RecorderHandle) {
    let mut last = (handle.progress(), Instant::now());
    while !recorder.is_finished() {
        if handle.progress() != last.0 {
            last = (handle.progress(), Instant::now());
        }
        if last.1.elapsed() > RECORDER_LIMIT {
            tracing::info!("what was being recorded is not on the disk yet: no longer waited for");
            return;
        }
        thread::sleep(LOOK);
    }
}

/// The store of the latched fault, if there can be one, and the fault that it holds.
fn stored_fault(robot: &str) -> Result<(Option<FaultStore>, Option<Event>), Failure> {
    let lasts = |why: Problem| tracing::warn!("a latched fault will not outlast a restart: {why}");
    let store = match StateDirectory::find(robot) {
        Ok(directory) => FaultStore::new(robot, directory),
        Err(why) => {
            lasts(why);
            return Ok((None, None));
        }
    };
    let fault = store.load().map_err(Failure::bad_input)?;
    if let Some(event) = fault {
        let (number, name) = (event.number(), event.name());
        tracing::error!(
            "FAULT {number} {name} was latched when torqued last ended, and still is: no set-point \
             is sent before an operator has acknowledged it. {}",
            event.cause()
        );
    }
    if let Err(why) = store.probe() {
        lasts(why);
    }
    Ok((Some(store), fault))
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
        description.joint_kinds[j] = joint.kind.number();
        description.torque_limits[j] = joint.limits.torque;
        description.position_min[j] = joint.limits.position_min;
        description.position_max[j] = joint.limits.position_max;
    }
    for (i, name) in robot_config::contact_names(parameters).iter().enumerate() {
        description.contact_set_names[i] = Name::new(name);
        description.contact_set_count += 1;
    }
    for (name, frame) in description.frame_names.iter_mut().zip(&parameters.frames) {
        *name = Name::new(&frame.name);
        description.frame_count += 1;
    }
    for (s, ft) in parameters.ft_sensors.iter().enumerate() {
        description.ft_names[s] = Name::new(&ft.sensor.name);
    }
    description
}
