//! Whether a robot may follow a planned motion: every point against the joints' limits, the torque of
//! inverse dynamics, the lead of the set-points, and the robot's own bodies.

use crate::hulls::{Distance, Hulls};
use crate::motion::{Motion, SPACING_S};
use crate::rigid::Rigid;
use control::DriveModel;
use problem::{Problem, Problems};
use robot_config::{JointParameters, Robot};
use robot_state::JointKind;
use supervisor::Limits;

/// Greatest share of the limits of velocity, torque, power and lead that a plan may take: the rest is
/// for the loop's feedback.
const SHARE: f64 = 0.9;
/// A plan stays this far from the position limits, rad; of prismatic joints the way that counts as much.
const MARGIN: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Most problems that are listed.
const LISTED: usize = 12;

/// Greatest demands on a joint, as shares of its limits, and its range, rad or m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Need {
    /// Lower end of its range, rad or m.
    pub least: f64,
    /// Upper end of its range, rad or m.
    pub most: f64,
    /// Velocity, share of the limit.
    pub velocity: f64,
    /// Acceleration, share of the limit.
    pub acceleration: f64,
    /// Torque, share of the limit.
    pub torque: f64,
    /// Lead of the set-point, share of the limit.
    pub lead: f64,
}

/// Needs of a motion.
#[derive(Debug, Clone)]
pub struct Needs {
    /// Those of each joint, in config order.
    pub joints: Vec<Need>,
    /// None: it was not checked.
    pub distance: Option<Distance>,
    /// Pairs of bodies that were not compared, as they touch where the motion begins.
    pub touching: Vec<(String, String)>,
    /// Bodies whose distance was not checked, as they have no geometry.
    pub without: Vec<String>,
}

/// Checks a motion; `hulls`: none leaves the self-distance out.
///
/// # Errors
/// Every kind of violation of each joint, where it is worst, with what is allowed.
pub(crate) fn check(
    robot: &Robot,
    motion: &Motion,
    hulls: Option<&Hulls>,
) -> Result<Needs, Problems> {
    let joints = &robot.parameters.joints;
    let mut rigid = Rigid::new(robot);
    let mut worst: Vec<[Worst; 6]> = vec![Default::default(); joints.len()];
    let mut needs: Vec<Need> = vec![NOTHING; joints.len()];
    // A joint that stands near its limit may stay there.
    let ranges: Vec<(f64, f64)> = (joints.iter().zip(motion.point(0)))
        .map(|(joint, start)| {
            let Limits {
                position_min,
                position_max,
                ..
            } = joint.limits;
            let margin = joint.kind.threshold(MARGIN);
            (
                (position_min + margin).min(start.q),
                (position_max - margin).max(start.q),
            )
        })
        .collect();
    for index in 0..motion.len() {
        let point = motion.point(index);
        rigid.set(point);
        let torques = rigid.torques().to_vec();
        for (j, (joint, at)) in joints.iter().zip(point).enumerate() {
            let rotor = rigid.rotor(j) * at.ddq;
            let torque = torques[j].abs().max((torques[j] + rotor).abs());
            let limits = &joint.limits;
            let outside = (ranges[j].0 - at.q).max(at.q - ranges[j].1);
            let shares = [
                outside,
                at.dq.abs() / limits.velocity,
                at.ddq.abs() / joint.desired_acceleration(),
                torque / limits.torque,
                lead(joint, torques[j]),
                torques[j] * at.dq / limits.power,
            ];
            let need = &mut needs[j];
            (need.least, need.most) = (need.least.min(at.q), need.most.max(at.q));
            need.velocity = need.velocity.max(shares[1]);
            need.acceleration = need.acceleration.max(shares[2]);
            need.torque = need.torque.max(shares[3]);
            need.lead = need.lead.max(shares[4]);
            for (worst, share) in worst[j].iter_mut().zip(shares) {
                worst.take(share, index);
            }
        }
    }
    let mut problems = Vec::new();
    for ((joint, worst), need) in joints.iter().zip(&worst).zip(&needs) {
        problems.extend(refusals(joint, worst, need, motion));
    }
    let mut found = Needs {
        joints: needs,
        distance: None,
        touching: Vec::new(),
        without: hulls.map_or_else(Vec::new, |hulls| hulls.without.clone()),
    };
    if let Some(hulls) = hulls {
        let (distance, touching) = hulls.least(&mut rigid, motion);
        if let Some(distance) = distance.as_ref().filter(|d| d.least_m < d.allowed_m) {
            let (a, b) = &distance.between;
            problems.push(Problem::new(
                format!(
                    "{a} and {b} come within {:.0} mm of each other at {:.1} s, in {:?}",
                    1e3 * distance.least_m,
                    distance.time_s,
                    motion.title((distance.time_s / SPACING_S).round() as usize)
                ),
                format!("at least {:.0} mm", 1e3 * distance.allowed_m),
            ));
        }
        (found.distance, found.touching) = (distance, touching);
    }
    problems.truncate(LISTED);
    if problems.is_empty() {
        Ok(found)
    } else {
        Err(Problems(problems))
    }
}

const NOTHING: Need = Need {
    least: f64::INFINITY,
    most: f64::NEG_INFINITY,
    velocity: 0.0,
    acceleration: 0.0,
    torque: 0.0,
    lead: 0.0,
};

/// The greatest value so far, and its point.
#[derive(Debug, Clone, Copy)]
struct Worst {
    value: f64,
    index: usize,
}

impl Default for Worst {
    fn default() -> Self {
        Self {
            value: f64::NEG_INFINITY,
            index: 0,
        }
    }
}

impl Worst {
    fn take(&mut self, value: f64, index: usize) {
        // A number that is none is the worst.
        if value > self.value || value.is_nan() {
            *self = Self { value, index };
        }
    }
}

/// Lead of the set-point over the joint for a torque, as a share of the greatest one.
fn lead(joint: &JointParameters, torque: f64) -> f64 {
    match joint.drive_model {
        DriveModel::Position(drive) => drive.k_tau * torque.abs() / joint.limits.lead,
        DriveModel::Current(drive) => torque.abs() / (drive.k_1 * drive.current_limit),
    }
}

/// Also true of a value that is no number.
fn exceeds(value: f64, most: f64) -> bool {
    value > most || value.is_nan()
}

fn refusals(
    joint: &JointParameters,
    worst: &[Worst; 6],
    need: &Need,
    motion: &Motion,
) -> Vec<Problem> {
    let name = &joint.name;
    let kind = joint.kind;
    let limits = &joint.limits;
    let place = |worst: &Worst| {
        let time = worst.index as f64 * SPACING_S;
        format!("at {time:.1} s, in {:?}", motion.title(worst.index))
    };
    let mut problems = Vec::new();
    if exceeds(worst[0].value, 1e-9) {
        let margin = kind.threshold(MARGIN);
        let (low, high) = (limits.position_min + margin, limits.position_max - margin);
        let unit = kind.units("deg");
        problems.push(Problem::new(
            format!(
                "joint {name:?} goes from {:.1} to {:.1} {unit}, {}",
                kind.shown(need.least),
                kind.shown(need.most),
                place(&worst[0])
            ),
            format!("{:.1} to {:.1} {unit}", kind.shown(low), kind.shown(high)),
        ));
    }
    let torque = match kind {
        JointKind::Revolute => "a torque",
        JointKind::Prismatic => "a force",
    };
    let shares = [
        ("a velocity", kind.shown(limits.velocity), "deg/s"),
        ("an acceleration", joint.desired_acceleration(), "rad/s²"),
        (torque, limits.torque, "N·m"),
        ("a lead", 1.0, "of its limit"),
        ("a power", limits.power, "W"),
    ];
    for (worst, (what, limit, unit)) in worst[1..].iter().zip(shares) {
        let unit = kind.units(unit);
        if exceeds(worst.value, SHARE) {
            problems.push(Problem::new(
                format!(
                    "joint {name:?} needs {what} of {:.3} {unit} {}",
                    worst.value * limit,
                    place(worst)
                ),
                format!("at most {:.3} {unit}", SHARE * limit),
            ));
        }
    }
    problems
}
