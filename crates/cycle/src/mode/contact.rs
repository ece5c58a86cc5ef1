//! Contact: how a limb answers a contact (event 209) that is not only warned of.
//!
//! The limb is the joint in contact with all joints beyond it, and those before it up to the first
//! branch of the tree or the root. It *complies*: inverse dynamics without stiffness, damped, with the
//! weight and loads of some time before the contact, since the forces of the contact itself are to
//! move it. Or it goes *back* to a pose on the way of its last second. It does neither where it
//! stands on a loaded foot, which would let the robot fall, nor further than a limit; then, and when
//! it has come back or, if so configured, the contact is over, it is stopped: braked at once, without
//! the gentle end of other stops, which would press on. So it is for the first milliseconds of any
//! answer.

use robot_config::{ContactReaction, Robot};
use robot_state::{JointKind, JointReference, MAX_JOINTS, MeasuredRecord, Mode, Reference};
use supervisor::time_in_a_row;

use super::position::Motions;
use super::{Answer, Asked, Entry, Feedback, Follow, Goal, JointGoal, RigidBody, Speed, Task};
use crate::estimate::Loads;
use crate::inputs::Seen;

/// Length of the way that is remembered, s. Chosen; no experiment recorded.
const MEMORY_S: f64 = 1.0;
/// Time between the poses of the way that is remembered, s. Chosen; no experiment recorded.
const POSES_S: f64 = 0.01;
/// Time between the offsets of torques, s: what counts is up to twice as old, of before the contact, which is found
/// within some 10 ms (docs/results/contact.md).
const OFFSETS_S: f64 = 0.05;
/// Least way that a limb goes back, over the configured one: one that has hardly moved did not come from anywhere.
/// Chosen; no experiment recorded.
const LEAST_WAY: f64 = 0.1;
/// Share of the robot's weight on an end from which on a limb bears the robot: as `BEARS` of
/// crates/control/src/support.rs.
const BEARING: f64 = 0.1;
/// Time for which the limb is braked at once before it yields, s: its own momentum makes the first and greatest force.
/// Chosen; no experiment recorded.
const BRAKING_S: f64 = 0.02;

/// Where the limb yields to.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    /// Soft.
    Soft,
    /// Back to a pose.
    Back,
    /// The limb does not yield, or no more: it is stopped.
    Ended,
}

/// One contact and what the limb does.
#[derive(Debug, Clone)]
struct Touched {
    way: Way,
    /// The limb yields from this cycle on.
    new: bool,
    /// Time for which it is still braked before, s.
    braking_s: f64,
    /// Index into the limbs.
    joint: usize,
    reference: Reference,
    loads: Loads,
    /// Poses at its begin, rad, and torques that are fed back less those of torsion before it, N·m.
    /// Later ones forget the contact, which no F/T sensor explains.
    begin: [f64; MAX_JOINTS],
    offsets: [Option<f64>; MAX_JOINTS],
    /// Time without contact, s.
    gone_s: f64,
}

#[derive(Debug)]
pub(super) struct Contact {
    settings: Option<ContactReaction>,
    sample_period: f64,
    /// Per joint: the joints of its limb, and the F/T sensors that these carry.
    limbs: Vec<Vec<bool>>,
    sensors: Vec<Vec<usize>>,
    /// Force on an end from which on its limb bears the robot, N; none with a fixed base.
    bearing: Option<f64>,
    /// K_d of each joint, N·m·s/rad.
    damping: Vec<f64>,
    /// Greatest way of each joint that complies, and way back of one that retracts, rad.
    comply: Vec<f64>,
    retract: Vec<f64>,
    /// The last poses, a row of joints each: a ring.
    poses: Vec<Vec<f64>>,
    newest: usize,
    kept: usize,
    since_pose_s: f64,
    /// Offsets of torques, the last ones and those before.
    offsets: [[Option<f64>; MAX_JOINTS]; 2],
    since_offset_s: f64,
    contact: Option<Touched>,
    motions: Motions,
}

impl Contact {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let limbs: Vec<Vec<bool>> = (p.joints.iter())
            .map(|joint| limb(robot, joint.model_index))
            .collect();
        let model = &robot.model;
        let sensors = |limb: &Vec<bool>| {
            let carries = |(_, ft): &(usize, &robot_config::FtParameters)| {
                let frame = model.frame_index(&ft.sensor.frame);
                let body = frame.map_or(0, |frame| model.frames()[frame].body);
                (p.joints.iter().zip(limb)).any(|(joint, own)| {
                    *own && bodies(robot, joint.model_index).any(|b| model.supports(b, body))
                })
            };
            let all = p.ft_sensors.iter().enumerate();
            all.filter(carries).map(|(s, _)| s).collect()
        };
        let settings = p.external_torque.as_ref().map(|e| e.reaction);
        let ways = |of_kind: Option<[f64; 2]>| -> Vec<f64> {
            let joints = p.joints.iter().map(|joint| match (of_kind, joint.kind) {
                (Some([angle, _]), JointKind::Revolute) => angle,
                (Some([_, length]), JointKind::Prismatic) => length,
                (None, _) => f64::INFINITY,
            });
            joints.collect()
        };
        let poses = match settings {
            Some(_) => (MEMORY_S / POSES_S) as usize,
            None => 0,
        };
        Self {
            sample_period: p.timing.sample_period,
            sensors: limbs.iter().map(sensors).collect(),
            limbs,
            bearing: (model.base() == dynamics::Base::Floating)
                .then(|| BEARING * dynamics::GRAVITY * model.total_mass()),
            damping: p.joints.iter().map(|joint| joint.gains.k_d).collect(),
            comply: ways(settings.map(|s| s.comply)),
            retract: ways(settings.map(|s| s.retract)),
            poses: vec![vec![0.0; p.joints.len()]; poses],
            newest: 0,
            kept: 0,
            since_pose_s: 0.0,
            offsets: [[None; MAX_JOINTS]; 2],
            since_offset_s: 0.0,
            contact: None,
            motions: Motions::new(p),
            settings,
        }
    }

    /// Goes on with the contact of the goal, or begins with it.
    pub(super) fn update(&mut self, goal: &Goal<'_>, seen: &Seen<'_>) {
        let (measured, estimated, loads) = (seen.measured, seen.estimated, seen.loads);
        let (Some(settings), &Goal::Contact { joint, answer }) = (self.settings, goal) else {
            self.contact = None;
            self.motions.end();
            self.remember(seen);
            return;
        };
        let Some(mut contact) = self.contact.take() else {
            self.contact = Some(self.begin(joint, answer, loads, measured));
            return;
        };
        let first = std::mem::replace(&mut contact.new, false);
        if answer == Answer::Stop {
            contact.way = Way::Ended;
        }
        let before = contact.braking_s;
        contact.braking_s = (before - self.sample_period).max(0.0);
        contact.new = before > 0.0 && contact.braking_s == 0.0;
        if before > 0.0 {
            self.contact = Some(contact);
            return;
        }
        let limb = self.limbs.get(contact.joint);
        let own = |j: usize| limb.and_then(|limb| limb.get(j)).copied() == Some(true);
        match contact.way {
            Way::Soft => {
                let joints = measured.joints.iter().zip(&contact.begin).enumerate();
                let mut moved = joints.zip(&self.comply).filter(|((j, _), _)| own(*j));
                let far = moved.any(|((_, (joint, q)), comply)| (joint.q - q).abs() > *comply);
                let mut joints = estimated.joints.iter().enumerate();
                let touched = joints.any(|(j, joint)| own(j) && joint.contact_flag == 1);
                let gone_s = time_in_a_row(&mut contact.gone_s, !touched, self.sample_period);
                let gone = settings.comply_until_gone;
                if far || gone.is_some_and(|gone| gone_s > gone) {
                    contact.way = Way::Ended;
                }
            }
            Way::Back if !first && self.motions.left_s() <= 0.0 => contact.way = Way::Ended,
            Way::Back | Way::Ended => {}
        }
        self.contact = Some(contact);
    }

    fn begin(
        &self,
        joint: usize,
        answer: Answer,
        loads: &Loads,
        measured: &MeasuredRecord,
    ) -> Touched {
        let mut reference = Reference {
            joint_count: self.damping.len() as u32,
            gains_given: u32::from(answer == Answer::Comply),
            ..Reference::default()
        };
        let joints = reference.joints.iter_mut().zip(&measured.joints);
        for ((asked, joint), damping) in joints.zip(&self.damping) {
            *asked = JointReference {
                q_d: joint.q,
                damping: *damping,
                ..JointReference::default()
            };
        }
        let way = match answer {
            Answer::Stop => Way::Ended,
            _ if self.bears(joint, loads) => Way::Ended,
            Answer::Comply => Way::Soft,
            Answer::Retract if self.lead_back(joint, measured, &mut reference) => Way::Back,
            Answer::Retract => Way::Ended,
        };
        Touched {
            way,
            new: false,
            braking_s: BRAKING_S,
            joint,
            reference,
            loads: *loads,
            begin: measured.joints.map(|joint| joint.q),
            offsets: self.offsets[1],
            gone_s: 0.0,
        }
    }

    /// The robot stands on the limb's end, or leans on it.
    fn bears(&self, joint: usize, loads: &Loads) -> bool {
        let Some(bearing) = self.bearing else {
            return false;
        };
        let force = |s: &usize| {
            let wrench = loads.contact.get(*s);
            wrench.map_or(0.0, |w| w.force.iter().map(|f| f * f).sum::<f64>().sqrt())
        };
        let sensors = self.sensors.get(joint);
        // A force that is no number bears as well.
        sensors.is_none_or(|all| all.iter().map(force).any(|f| f.is_nan() || f >= bearing))
    }

    /// Puts the pose on the way of the last second at which the limb's joint that has come furthest, as a
    /// share of its way back, was that way away into the reference; false where it has hardly moved.
    fn lead_back(
        &self,
        joint: usize,
        measured: &MeasuredRecord,
        reference: &mut Reference,
    ) -> bool {
        let Some(limb) = self.limbs.get(joint) else {
            return false;
        };
        let mut furthest: Option<(&[f64], f64)> = None;
        for age in 0..self.kept {
            let row = (self.newest + self.poses.len() - age) % self.poses.len().max(1);
            let Some(pose) = self.poses.get(row) else {
                break;
            };
            let ways = pose
                .iter()
                .zip(&measured.joints)
                .zip(limb.iter().zip(&self.retract));
            let way = ways
                .filter(|(_, (own, _))| **own)
                .fold(0.0f64, |most, ((q, joint), (_, retract))| {
                    most.max((q - joint.q).abs() / retract)
                });
            if furthest.is_none_or(|(_, most)| way > most) {
                furthest = Some((pose, way));
            }
            if way >= 1.0 {
                break;
            }
        }
        let Some((pose, way)) = furthest.filter(|(_, way)| *way >= LEAST_WAY) else {
            return false;
        };
        let share = (1.0 / way).min(1.0);
        let joints = reference.joints.iter_mut().zip(pose).zip(limb);
        for ((asked, q), _) in joints.filter(|(_, own)| **own) {
            asked.q_d += share * (q - asked.q_d);
        }
        true
    }

    /// Poses, and offsets of the torques that are fed back over those of torsion, N·m.
    fn remember(&mut self, seen: &Seen<'_>) {
        let measured = seen.measured;
        let offset = |j: usize| Some(seen.fast_torque(j)? - seen.fast.get(j)?.torsion?);
        self.since_offset_s += self.sample_period;
        if self.since_offset_s >= OFFSETS_S {
            self.since_offset_s = 0.0;
            self.offsets = [std::array::from_fn(offset), self.offsets[0]];
        }
        self.since_pose_s += self.sample_period;
        if self.since_pose_s < POSES_S || self.poses.is_empty() {
            return;
        }
        self.since_pose_s = 0.0;
        self.newest = (self.newest + 1) % self.poses.len();
        self.kept = (self.kept + 1).min(self.poses.len());
        if let Some(pose) = self.poses.get_mut(self.newest) {
            for (q, joint) in pose.iter_mut().zip(&measured.joints) {
                *q = joint.q;
            }
        }
    }

    /// Sets each joint's task: the limb in contact answers it, all others stop.
    pub(super) fn set_tasks(&mut self, seen: &Seen<'_>, body: &mut RigidBody, tasks: &mut [Task]) {
        let is_new = self.contact.as_ref().is_some_and(|contact| contact.new);
        let planned = match self.reference(Way::Back).copied() {
            // A limb that goes back is a motion to a target.
            Some(target) => Some((self.motions).follow(&target, is_new, seen.measured, seen.dt)),
            None => {
                self.motions.end();
                self.reference(Way::Soft).copied()
            }
        };
        // The contact itself is to move the limb.
        let loads = self.contact.as_ref().map(|contact| contact.loads.contact);
        if let (Some(planned), Some(loads)) = (&planned, &loads) {
            body.follow_under(planned, seen, loads);
        }
        let entry = if is_new {
            Entry::ContactAnew
        } else {
            Entry::Contact
        };
        for (j, task) in tasks.iter_mut().enumerate() {
            let goal = match planned.as_ref().filter(|_| self.yields(j)) {
                Some(reference) => {
                    let asked = Asked::planned(reference);
                    JointGoal::Follow(Follow {
                        entry,
                        speed: Speed::Torque,
                        ..Follow::tracking(Mode::InverseDynamics, &asked, body, j)
                    })
                }
                None if self.concerns(j) => JointGoal::StopPressing,
                None => JointGoal::Stop,
            };
            let offset = self.torque_offset(j);
            *task = Task {
                goal,
                feedback: offset.map_or(Feedback::default(), |offset| Feedback::Torsion { offset }),
            };
        }
    }

    /// Time until a limb that goes back is there, s.
    pub(super) fn motion_left_s(&self) -> f64 {
        self.motions.left_s()
    }

    /// The joint belongs to the limb in contact.
    fn concerns(&self, joint: usize) -> bool {
        self.contact.as_ref().is_some_and(|contact| {
            let limb = self.limbs.get(contact.joint);
            limb.and_then(|limb| limb.get(joint)) == Some(&true)
        })
    }

    /// Whether the joint is in the limb in contact, and that limb yields.
    fn yields(&self, joint: usize) -> bool {
        let contact = self.contact.as_ref();
        let yields = |c: &Touched| c.way != Way::Ended && c.braking_s == 0.0;
        contact.is_some_and(yields) && self.concerns(joint)
    }

    /// The joint's torque over that of torsion, N·m, for a limb in contact.
    fn torque_offset(&self, joint: usize) -> Option<f64> {
        let contact = self.contact.as_ref().filter(|_| self.concerns(joint))?;
        contact.offsets.get(joint).copied().flatten()
    }

    fn reference(&self, way: Way) -> Option<&Reference> {
        let contact = self.contact.as_ref()?;
        (contact.way == way && contact.braking_s == 0.0).then_some(&contact.reference)
    }
}

/// Bodies that a joint of the model moves: several with mimic joints.
fn bodies(robot: &Robot, joint: usize) -> impl Iterator<Item = usize> {
    let bodies = robot.model.bodies().iter().enumerate().skip(1);
    bodies
        .filter(move |(_, body)| body.joint == joint)
        .map(|(b, _)| b)
}

/// Per joint, in config order: it belongs to the limb of a joint of the model.
fn limb(robot: &Robot, joint: usize) -> Vec<bool> {
    let model = &robot.model;
    let Some(mut top) = bodies(robot, joint).next() else {
        return vec![false; robot.parameters.joints.len()];
    };
    let children = |parent: usize| {
        let all = 1..model.bodies().len();
        all.filter(|&b| model.parent(b) == Some(parent)).count()
    };
    while let Some(parent) = model.parent(top).filter(|&p| p != 0 && children(p) == 1) {
        top = parent;
    }
    let joints = robot.parameters.joints.iter();
    joints
        .map(|joint| bodies(robot, joint.model_index).any(|b| model.supports(top, b)))
        .collect()
}
