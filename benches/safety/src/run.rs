//! One scenario in one robot: what is seen, what follows, and what the joints truly do.

use cycle::OperatorRequest;
use problem::Problem;
use robot_state::{EVENT_COUNT, Event, JointKind, Mode, RobotState};
use serde::Serialize;
use std::f64::consts::PI;

use crate::motion::{Motion, Moved, Reference, STEP_CYCLES};
use crate::rig::{At, Fault, Rig};
use crate::robots::Prepared;
use crate::scenarios::{Bound, Place, Scenario, Start};

/// Cycles that are observed from the fault's first one on.
const OBSERVED: usize = 1000;
/// Cycles for which a standing robot is observed: it takes longer to fall from a fault that nobody sees.
const OBSERVED_STANDING: usize = 2000;
/// Cycles until a robot that is switched on holds, with its filters full.
const SETTLING: usize = 500;
/// Further cycles until IMUs have agreed for the second that makes one stand in for another.
const AGREEING: usize = 700;
/// Cycles in a client's mode before the fault: the blend into it takes 300.
const IN_MODE: usize = 350;
/// The same of a frame that presses: its force feedback takes half a second to begin.
const PRESSING: usize = 1000;
/// Cycles until a standing robot is at rest: its centre of mass is led over its soles first.
const STANDING: usize = 2500;
/// Share of its greatest force with which a frame presses.
const PRESSED: f64 = 0.2;
/// Greatest amplitude of the motion of a prismatic joint, as the share of its velocity limit at which it then
/// moves.
const PRISMATIC_SHARE: f64 = 0.1;
/// Cycles after an operator's request within which the robot is where it leads.
const RECOVERY: usize = 400;
/// Greatest uncommanded displacement, rad, share of the velocity limit, share of the torque limit.
const DISPLACEMENT: f64 = PI / 180.0;
const SPEED_SHARE: f64 = 0.1;
/// Share of the velocity limit that a drive which follows something else may reach before it is off.
const STRAYING_SHARE: f64 = 0.35;
const STEP_SHARE: f64 = 0.05;
/// Excess over set-points that stay as they are before a reaction counts as making it worse.
const PHYSICS_MARGIN: f64 = 1.1;

/// How it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within the bounds.
    Holds,
    /// Beyond them, but by no more than the fault itself moves a robot whose set-points stay, or than
    /// all sensors of the joint show.
    Physics,
    /// Beyond them.
    Fails,
}

/// Result of a scenario.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The scenario.
    #[serde(skip)]
    pub scenario: &'static str,
    /// Its heading.
    #[serde(skip)]
    pub group: &'static str,
    /// State at the beginning.
    pub start: &'static str,
    /// The joint's name.
    pub joint: String,
    /// Time to the first event that the run without the fault does not have, ms.
    pub detected_ms: Option<usize>,
    /// That event's number.
    pub event: u32,
    /// Time to the latched fault, or to the end of the client's mode, ms.
    pub reacted_ms: Option<usize>,
    /// The latched fault's number, or 0.
    pub fault: u32,
    /// State after a second.
    pub state: &'static str,
    /// The client's mode goes on.
    pub follows: bool,
    /// Motion in that second, beyond what the client asked for.
    #[serde(flatten)]
    pub moved: Moved,
    /// Motion with set-points that stay as they were, where the fault itself moves the robot, or with
    /// ideal sources of the commanded torques.
    pub beside: Option<Moved>,
    /// With the fault gone, one acknowledgement and one enabling lead to holding; none: the fault
    /// does not go away.
    pub recovered: Option<bool>,
    /// Within the bounds or not.
    pub verdict: Verdict,
    /// Digest of all records and commands of the run: equal where two states of the code are equal bit for bit.
    pub digest: String,
}

/// Of the humanoid the arms move, or are let go.
pub(crate) fn is_of_arm(name: &str) -> bool {
    ["shoulder", "elbow", "wrist"]
        .iter()
        .any(|arm| name.contains(arm))
}

/// Bits of the joints that a client of mode passive keeps held.
fn held(rig: &Rig) -> u64 {
    let p = &rig.robot.parameters;
    let joints = p.joints.iter().enumerate();
    let held = joints.filter(|(_, j)| p.name == "humanoid" && !is_of_arm(&j.name));
    held.fold(0, |bits, (j, _)| bits | 1 << j)
}

/// The client's motion: 0.25 rad at 0.5 Hz.
fn moving(rig: &Rig) -> Fault {
    let moves: Vec<bool> = (rig.robot.parameters.joints.iter())
        .map(|joint| {
            let whole = rig.robot.parameters.name != "humanoid";
            whole || is_of_arm(&joint.name)
        })
        .collect();
    let q_0 = rig.client.reference.joints.map(|joint| joint.q_d);
    let ways: Vec<f64> = (rig.robot.parameters.joints.iter())
        .map(|joint| match joint.kind {
            JointKind::Revolute => 0.125,
            JointKind::Prismatic => PRISMATIC_SHARE * joint.limits.velocity / PI,
        })
        .collect();
    Box::new(move |at, rig, k| {
        if at != At::Client {
            return;
        }
        let (w, t) = (PI, 1e-3 * k as f64);
        let joints = rig.client.reference.joints.iter_mut();
        let moving = moves.iter().zip(&ways);
        for ((joint, q_0), (_, way)) in joints.zip(q_0).zip(moving).filter(|(_, m)| *m.0) {
            joint.q_d = q_0 + way * (1.0 - (w * t).cos());
            joint.dq_d = way * w * (w * t).sin();
            joint.ddq_d = way * w * w * (w * t).cos();
        }
    })
}

/// Cycles that are observed.
pub(crate) fn observed(start: Start) -> usize {
    match start {
        Start::Stand => OBSERVED_STANDING,
        _ => OBSERVED,
    }
}

/// A robot in the state in which the fault begins, and the client's motion there.
pub(crate) fn begin(
    prepared: &Prepared,
    place: &Place,
    setup: Option<fn(&mut Rig, &Place)>,
) -> Result<(Rig, Option<Fault>), Problem> {
    let mut rig = match place.start {
        Start::Pressing => Rig::clamped(prepared)?,
        _ => Rig::new(prepared)?,
    };
    if let Some(setup) = setup {
        setup(&mut rig, place);
    }
    if place.start == Start::PowerOn {
        return Ok((rig, None));
    }
    rig.run(SETTLING);
    if rig.robot.parameters.imus.len() > 1 {
        rig.run(AGREEING);
    }
    expect(&rig, place, RobotState::Holding)?;
    if place.start == Start::Hold {
        return Ok((rig, None));
    }
    rig.follow(Mode::Hold);
    if place.start.mode() == Mode::Cartesian {
        rig.client.reference.frames[0] = rig.frame();
    }
    rig.run(2);
    rig.follow(place.start.mode());
    if place.start == Start::Passive {
        rig.client.reference.held_joints = held(&rig);
    }
    if place.start == Start::Pressing {
        let frame = rig.robot.parameters.frames.first();
        let force = frame.map_or(0.0, |frame| PRESSED * frame.limits.wrench[0]);
        rig.press([0.0, 0.0, force]);
        rig.run(PRESSING - IN_MODE);
    }
    if place.start == Start::Stand {
        rig.run(STANDING - IN_MODE);
    }
    if place.start != Start::Motion {
        rig.run(IN_MODE);
        expect(&rig, place, RobotState::Active)?;
        return Ok((rig, None));
    }
    let mut motion = moving(&rig);
    (0..IN_MODE).for_each(|k| _ = rig.step(Some((&mut motion, k))));
    expect(&rig, place, RobotState::Active)?;
    let shifted: Fault = Box::new(move |at, rig, k| motion(at, rig, k + IN_MODE));
    Ok((rig, Some(shifted)))
}

fn expect(rig: &Rig, place: &Place, state: RobotState) -> Result<(), Problem> {
    if rig.state() == state {
        return Ok(());
    }
    let record = rig.cycle.record();
    let reason = format!(
        "{}, {}: {} with fault {}, not {}",
        place.variant.name(),
        place.start.name(),
        rig.state().name(),
        record.fault,
        state.name()
    );
    Err(Problem::new(reason, ""))
}

/// The client asks for motion. In mode torque it asks for none: a joint that goes wherever the error of an
/// estimated torque leads it moves uncommanded.
fn moves_by_itself(start: Start) -> bool {
    start == Start::Motion
}

/// The run without a fault that others are compared with.
///
/// # Errors
/// A robot that does not get into the state.
pub fn reference(
    prepared: &Prepared,
    place: &Place,
    setup: Option<fn(&mut Rig, &Place)>,
) -> Result<Reference, Problem> {
    let (mut rig, mut motion) = begin(prepared, place, setup)?;
    let mut moved = Motion::of(&rig, None);
    let cycles = observed(place.start);
    let mut events = Vec::with_capacity(cycles);
    for k in 0..cycles {
        rig.step(motion.as_mut().map(|motion| (motion, k)));
        events.push(rig.cycle.record().events);
        if moves_by_itself(place.start) {
            moved.widen(&rig);
        }
        moved.take(&rig);
    }
    let range = match place.start {
        start if moves_by_itself(start) => moved.range,
        // At rest the pose at the beginning counts, not where the robot goes by itself.
        _ => moved
            .range
            .iter()
            .map(|&(low, _, _)| (low, low, 0.0))
            .collect(),
    };
    Ok(Reference {
        events,
        range,
        taus: moved.taus,
        moved: moved.moved,
    })
}

/// Runs one scenario.
///
/// # Errors
/// A robot that does not get into the state.
pub fn run(
    prepared: &Prepared,
    scenario: &Scenario,
    place: Place,
    reference: &Reference,
) -> Result<Outcome, Problem> {
    let (mut rig, mut client) = begin(prepared, &place, scenario.setup)?;
    let mut fault = (scenario.make)(place);
    let mut motion = Motion::of(&rig, Some(reference));
    let mode = rig.cycle.record().mode;
    let mut outcome = Outcome {
        scenario: scenario.name,
        group: scenario.group,
        start: place.start.name(),
        joint: rig.robot.parameters.joints[place.joint].name.clone(),
        detected_ms: None,
        event: 0,
        reacted_ms: None,
        fault: 0,
        state: "",
        follows: false,
        moved: Moved::default(),
        beside: None,
        recovered: None,
        verdict: Verdict::Holds,
        digest: String::new(),
    };
    let mut act: Fault = Box::new(move |at, rig, k| {
        if let Some(client) = &mut client {
            client(at, rig, k);
        }
        fault(at, rig, k);
    });
    let cycles = observed(place.start);
    for k in 0..cycles {
        rig.step(Some((&mut act, k)));
        motion.take(&rig);
        let record = rig.cycle.record();
        if outcome.detected_ms.is_none()
            && let Some(event) = new_event(&record.events, &reference.events[k])
        {
            (outcome.detected_ms, outcome.event) = (Some(k), event.number());
        }
        let ended = record.fault != 0 || mode != Mode::Hold.number() && record.mode != mode;
        if ended {
            outcome.reacted_ms.get_or_insert(k);
        }
        if outcome.fault == 0 {
            outcome.fault = record.fault;
        }
    }
    outcome.state = rig.state().name();
    outcome.follows = rig.state() == RobotState::Active;
    outcome.moved = motion.moved;
    let bound = scenario.bound_at(&place);
    let beside = match bound {
        Bound::Torque => None,
        _ if (scenario.ideal)(&place) => Some(Beside::Ideal),
        Bound::Physics => Some(Beside::Kept(cycles)),
        Bound::Gap(cycles) => Some(Beside::Kept(cycles + STEP_CYCLES)),
        _ => None,
    };
    outcome.beside =
        (beside.map(|of| run_beside(of, prepared, scenario, place, reference))).transpose()?;
    // Of a drive that goes on to follow something else nothing is to be recovered.
    if !matches!(bound, Bound::Physics | Bound::Torque | Bound::Straying) {
        outcome.recovered = Some(recovers(&mut rig));
    }
    outcome.verdict = judge(bound, &outcome.moved, outcome.beside.as_ref(), cycles);
    outcome.digest = rig.digest.to_string();
    Ok(outcome)
}

/// The first event that the run without a fault has not had; limits come last.
fn new_event(now: &[u64; EVENT_COUNT], without: &[u64; EVENT_COUNT]) -> Option<Event> {
    let limits = [
        Event::PositionLimit,
        Event::TorqueLimit,
        Event::VelocityLimit,
    ];
    let new = |event: &&Event| now[event.index()] > without[event.index()];
    let others = Event::ALL.iter().filter(|event| !limits.contains(event));
    (others.into_iter())
        .find(new)
        .or_else(|| limits.iter().find(new))
        .copied()
}

/// Run that another is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Beside {
    /// Motion by the fault alone: the loop does not compute, its last set-points are repeated, for so
    /// many cycles.
    Kept(usize),
    /// Motion by ideal sources of the torques that the client asks for; in modes torque and Cartesian
    /// already, of those that the joints make, as the sensors need not know every load.
    Ideal,
}

fn run_beside(
    beside: Beside,
    prepared: &Prepared,
    scenario: &Scenario,
    place: Place,
    reference: &Reference,
) -> Result<Moved, Problem> {
    let (mut rig, mut client) = begin(prepared, &place, scenario.setup)?;
    let mut fault = (scenario.make)(place);
    let mut motion = Motion::of(&rig, Some(reference));
    let kept = rig.sent.clone();
    let made = rig.plant.truth().joints.iter().map(|j| j.gear_torque);
    let asked = rig.client.reference.joints.map(|joint| joint.tau_d);
    let unknown: Vec<f64> = made
        .zip(asked)
        .map(|(made, asked)| {
            if place.start.gives_way() {
                made - asked
            } else {
                0.0
            }
        })
        .collect();
    rig.frozen = true;
    let mut act: Fault = Box::new(move |at, rig, k| {
        if let Some(client) = &mut client {
            client(at, rig, k);
        }
        if at == At::Commands {
            rig.sent.clone_from(&kept);
        }
        fault(at, rig, k);
        if beside == Beside::Ideal && at == At::Client {
            let joints = rig.client.reference.joints;
            for (j, (joint, unknown)) in joints.iter().zip(&unknown).enumerate() {
                rig.plant
                    .robot_mut()
                    .drive_ideally(j, joint.tau_d + unknown);
            }
        }
    });
    let cycles = match beside {
        Beside::Kept(cycles) => cycles.min(observed(place.start)),
        Beside::Ideal => observed(place.start),
    };
    for k in 0..cycles {
        rig.step(Some((&mut act, k)));
        motion.take(&rig);
    }
    Ok(motion.moved)
}

/// The fault is gone and the client silent: one acknowledgement and one enabling lead to holding.
fn recovers(rig: &mut Rig) -> bool {
    rig.client.speaks = false;
    rig.client.settings = None;
    rig.mend_drives();
    rig.run(RECOVERY);
    let fault = rig.cycle.record().fault;
    if fault != 0 {
        rig.ask(OperatorRequest::Acknowledge(fault));
        rig.run(RECOVERY);
    }
    if rig.state() == RobotState::Ready {
        rig.ask(OperatorRequest::Enable);
        rig.run(RECOVERY);
    }
    rig.state() == RobotState::Holding
}

fn judge(bound: Bound, moved: &Moved, beside: Option<&Moved>, cycles: usize) -> Verdict {
    let still = moved.displacement <= DISPLACEMENT && moved.speed_share <= SPEED_SHARE;
    let steps = matches!(
        bound,
        Bound::MotionAndStep | Bound::Gap(_) | Bound::Approach
    );
    let stepless = !steps || moved.step_share <= STEP_SHARE;
    if still && stepless {
        return Verdict::Holds;
    }
    let no_worse = |beside: &Moved| {
        let step = match bound {
            Bound::Gap(_) => PHYSICS_MARGIN * beside.step_share,
            _ => 0.0,
        };
        moved.displacement <= DISPLACEMENT.max(PHYSICS_MARGIN * beside.displacement)
            && moved.speed_share <= SPEED_SHARE.max(PHYSICS_MARGIN * beside.speed_share)
            && (!steps || moved.step_share <= STEP_SHARE.max(step))
    };
    let as_shown = match bound {
        Bound::Torque => moved.torque_speed_share <= PHYSICS_MARGIN,
        Bound::Straying => {
            moved.displacement <= DISPLACEMENT && moved.speed_share <= STRAYING_SHARE
        }
        Bound::Approach => moved.speed_share <= SPEED_SHARE && stepless,
        Bound::Shown(rate) => {
            let way = rate * cycles as f64 * 1e-3;
            moved.displacement <= PHYSICS_MARGIN * way && moved.speed_share <= SPEED_SHARE
        }
        _ => false,
    };
    if as_shown || beside.is_some_and(no_worse) {
        Verdict::Physics
    } else {
        Verdict::Fails
    }
}
