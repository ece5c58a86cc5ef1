//! Whole robots in the demo's motion, in lock-step.

use crate::variant::{Conditions, Happens, apply};
use can_codec::{Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use plant::{CanRobot, SimParameters, Truth};
use robot_config::{Parameters, Robot};
use robot_state::{CommanderRecord, CycleRecord, Mode, Reference, Settings, SharedRecord};
use torqued::demo::{DemoClient, Motion};

/// How a robot did, over its joints.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Judged {
    /// Root mean square of `q - q_d`, mean over the joints, degrees.
    pub(crate) position: f64,
    /// Root mean square of `tau - tau_d`, mean over the joints, N·m.
    pub(crate) torque: f64,
    /// Torque's ripple beyond 5 Hz, mean over the joints and worst, N·m.
    pub(crate) ripple: [f64; 2],
    /// Largest change of the torque from one cycle to the next, over the torque limit.
    pub(crate) step: f64,
    /// The latched fault, or 0.
    pub(crate) fault: u32,
}

impl Judged {
    /// The worst of both.
    pub(crate) fn worst(self, other: Self) -> Self {
        Self {
            position: self.position.max(other.position),
            torque: self.torque.max(other.torque),
            ripple: [0, 1].map(|i| self.ripple[i].max(other.ripple[i])),
            step: self.step.max(other.step),
            fault: self.fault.max(other.fault),
        }
    }
}

/// Text of a file of the project.
///
/// # Errors
/// No such file.
pub(crate) fn read(path: &str) -> std::io::Result<String> {
    std::fs::read_to_string(format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR")))
}

/// Loads a robot and its simulation.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn load(name: &str) -> Result<(Robot, SimParameters), String> {
    let robot = robot_config::load(&format!("config/{name}/robot.toml"), &read);
    let path = format!("config/{name}/sim.toml");
    let text = read(&path).map_err(|e| format!("{path}: {e}"))?;
    let sim = SimParameters::parse(&text, &path).map_err(|e| e.to_string())?;
    Ok((robot.map_err(|e| e.to_string())?, sim))
}

/// Seconds at the start that do not count: hand-over and the motion's beginning.
const START: f64 = 2.0;

/// A robot that is run through the demo's motion.
pub(crate) struct Driven<'a> {
    /// Its configuration's folder.
    pub(crate) name: &'a str,
    /// Time, s.
    pub(crate) seconds: f64,
    /// The conditions.
    pub(crate) conditions: &'a Conditions,
    /// Changes what the loop is given, and the simulated robot's URDF.
    pub(crate) change: &'a dyn Fn(&mut Robot, &mut String),
    /// Changes the demo's references.
    pub(crate) ask: &'a dyn Fn(&mut Reference),
}

impl Driven<'_> {
    /// Runs it; `each` cycle after its commands: time, reference, record, truth. The parameters it ran with.
    ///
    /// # Errors
    /// Files that cannot be read, parts that do not fit.
    pub(crate) fn run(
        &self,
        mut each: impl FnMut(f64, &Reference, &CycleRecord, &Truth),
    ) -> Result<Parameters, String> {
        let (name, conditions) = (self.name, self.conditions);
        let (mut robot, mut sim) = load(name)?;
        apply(conditions, &mut robot, &mut sim);
        let mut urdf = read(&robot.parameters.urdf_path).map_err(|e| e.to_string())?;
        (self.change)(&mut robot, &mut urdf);
        let p = &robot.parameters;
        let mut plant = CanRobot::new(&robot, &urdf, &sim).map_err(|e| e.to_string())?;
        let path = test_support::judged_motion(name);
        let names: Vec<_> = p.joints.iter().map(|j| (j.name.clone(), j.kind)).collect();
        let motion = read(&path).map_err(|e| e.to_string())?;
        let motion = Motion::parse(&motion, &path, &names).map_err(|e| e.to_string())?;
        let mut client = DemoClient::new(&robot, motion);
        let mut cycle = Cycle::new(&robot).map_err(|e| e.to_string())?;
        let (mut rx, mut tx) = (Frames::new(MAX_FRAMES), Frames::new(MAX_FRAMES));
        let (mut sync, mut none) = (Frames::default(), Frames::default());
        for frame in &robot.sync {
            sync.push(*frame);
        }
        let dt = p.timing.sample_period;
        let mut now = 1_000_000_000_u64;
        let mut record = Box::new(SharedRecord::default());
        let contacts = conditions.happens == Happens::Contacts;
        for k in 0..(self.seconds / dt) as usize {
            now += (1e9 * dt) as u64;
            rx.clear();
            plant.exchange(&sync, now, &mut rx);
            tx.clear();
            let at = Instants {
                sync: Stamp(now),
                now: Stamp(now),
            };
            let settings = contacts.then(|| Settings {
                sequence: 1,
                // One foot, both again: what the motion's contact sets begin with.
                contact_set: if (3500..5500).contains(&k) { 2 } else { 1 },
                ..Settings::default()
            });
            let mut reference = *client.reference();
            (self.ask)(&mut reference);
            let input = ClientInput {
                reference: Some(&reference),
                age_s: 0.0,
                commander: CommanderRecord::default(),
                settings: settings.as_ref(),
                request: None,
            };
            record.cycle = *cycle.step(at, &rx, &input, &mut tx);
            each(k as f64 * dt, &reference, &record.cycle, plant.truth());
            client.observe(&record);
            plant.exchange(&tx, now, &mut none);
        }
        Ok(robot.parameters)
    }
}

/// Runs a robot through the demo's motion.
///
/// # Errors
/// Files that cannot be read, parts that do not fit.
pub(crate) fn run(name: &str, seconds: f64, conditions: &Conditions) -> Result<Judged, String> {
    let mut traces: Vec<Trace> = Vec::new();
    let (mut cycles, mut fault) = (0, 0);
    let driven = Driven {
        name,
        seconds,
        conditions,
        change: &|_, _| {},
        ask: &|_| {},
    };
    let p = driven.run(|t, reference, record, truth| {
        (cycles, fault) = (cycles + 1, record.fault);
        traces.resize_with(truth.joints.len(), Trace::default);
        if t <= START || record.mode != Mode::InverseDynamics.number() {
            return;
        }
        for (j, (trace, truth)) in traces.iter_mut().zip(&truth.joints).enumerate() {
            trace.position.push(truth.q - reference.joints[j].q_d);
            trace.torque.push(truth.tau);
            trace
                .error
                .push(truth.tau - record.commanded.joints[j].tau_d);
        }
    })?;
    let dt = p.timing.sample_period;
    if traces.iter().any(|trace| trace.torque.len() * 3 < cycles) {
        return Err(format!("{name}: fault {fault}"));
    }
    let n = traces.len() as f64;
    let mean = |of: &dyn Fn(&Trace) -> f64| traces.iter().map(of).sum::<f64>() / n;
    let most = |of: &dyn Fn(&Trace) -> f64| traces.iter().map(of).fold(0.0, f64::max);
    let limits = p.joints.iter().map(|joint| joint.limits.torque);
    let steps = traces.iter().zip(limits).map(|(t, limit)| t.step() / limit);
    Ok(Judged {
        position: mean(&|t| rms(&t.position)).to_degrees(),
        torque: mean(&|t| rms(&t.error)),
        ripple: [
            mean(&|t| ripple(&t.torque, dt)),
            most(&|t| ripple(&t.torque, dt)),
        ],
        step: steps.fold(0.0, f64::max),
        fault,
    })
}

#[derive(Clone, Default)]
struct Trace {
    position: Vec<f64>,
    torque: Vec<f64>,
    error: Vec<f64>,
}

impl Trace {
    fn step(&self) -> f64 {
        let steps = self.torque.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        steps.fold(0.0, f64::max)
    }
}

/// Root mean square.
pub(crate) fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len().max(1) as f64).sqrt()
}

/// Root mean square beyond 5 Hz: less the mean over 200 ms.
fn ripple(x: &[f64], dt: f64) -> f64 {
    let half = (0.1 / dt) as usize;
    let mut sums = vec![0.0];
    for x in x {
        sums.push(sums[sums.len() - 1] + x);
    }
    let fast: Vec<f64> = (half..x.len().saturating_sub(half))
        .map(|i| x[i] - (sums[i + half] - sums[i - half]) / (2 * half) as f64)
        .collect();
    rms(&fast)
}
