//! Check of a client's references for frames: whether the robot can follow them; placements of links.

use control::{DAMPING_RATIOS, unit_quaternion};
use dynamics::{Base, Data, Model, Se3, forward_kinematics, frame_placement};
use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector6};
use robot_config::{FrameParameters, Robot};
use robot_state::{FrameReference, JointMeasured, MAX_FRAMES, MeasuredRecord, Reference};

/// Departure of a quaternion's length from 1 that counts as rounding: four components of four written digits err by
/// less.
const QUATERNION: f64 = 1e-3;
/// Time whose way at the greatest velocity a frame's first target may be away, s: as that of joints (`FIRST_DISTANCE_S`
/// of mode/reference.rs).
const FIRST_DISTANCE_S: f64 = 0.05;
/// For rounding of values that are meant to be the limit: as `ROUNDING` of crates/control/src/trajectory.rs.
const ROUNDING: f64 = 1.001;

/// Placements of links in the root, from measured angles.
#[derive(Debug, Clone)]
pub(super) struct Placements {
    pub(super) model: Model,
    pub(super) data: Data,
    pub(super) q: Vec<f64>,
    /// Place of each joint, in config order, in `q`.
    pub(super) place: Vec<usize>,
}

impl Placements {
    pub(super) fn new(robot: &Robot) -> Self {
        let model = robot.model.clone();
        let mut q = vec![0.0; model.nq()];
        let base = model.base_size().1;
        if model.base() == Base::Floating {
            q[6] = 1.0;
        }
        let joints = robot.parameters.joints.iter();
        Self {
            data: Data::new(&model),
            place: joints.map(|joint| base + joint.model_index).collect(),
            q,
            model,
        }
    }

    pub(super) fn set_angles(&mut self, joints: &[JointMeasured]) {
        for (&place, joint) in self.place.iter().zip(joints) {
            if let Some(q) = self.q.get_mut(place) {
                *q = joint.q;
            }
        }
    }

    pub(super) fn set(&mut self, joints: &[JointMeasured]) {
        self.set_angles(joints);
        forward_kinematics(&self.model, &mut self.data, &self.q);
    }

    /// Placement of a link in another one.
    pub(super) fn between(&self, base: usize, link: usize) -> Se3 {
        let at = |frame| frame_placement(&self.model, &self.data, frame);
        at(base).inverse().compose(&at(link))
    }
}

/// The check of what a client asks of frames.
#[derive(Debug)]
pub(super) struct FrameCheck {
    frames: Vec<Allowed>,
    placements: Option<Placements>,
    /// The frames that the mode began with: used, own axes.
    began: [(u32, u32); MAX_FRAMES],
}

#[derive(Debug)]
struct Allowed {
    parameters: FrameParameters,
    /// Greatest distance of the frame from its base, m.
    reach: f64,
}

/// Every number of every frame is finite.
pub(in crate::mode) fn is_finite(reference: &Reference) -> bool {
    reference.frames.iter().all(|frame| {
        let six = [frame.velocity, frame.stiffness, frame.force];
        let numbers = frame.position.iter().chain(&frame.orientation);
        let mut numbers = numbers.chain(six.iter().flatten());
        numbers.all(|x| x.is_finite()) && frame.damping_ratio.is_finite()
    })
}

impl FrameCheck {
    pub(super) fn new(robot: &Robot) -> Self {
        let frames = &robot.parameters.frames;
        Self {
            frames: frames
                .iter()
                .map(|f| Allowed::new(f, &robot.model))
                .collect(),
            placements: (!frames.is_empty()).then(|| Placements::new(robot)),
            began: [(0, 0); MAX_FRAMES],
        }
    }

    /// Whether at least one frame is used, and every value of the used ones is one that the frame can have.
    pub(super) fn is_within(&self, reference: &Reference) -> bool {
        let used = || reference.frames.iter().filter(|frame| frame.used != 0);
        let mut others = reference.frames.iter().skip(self.frames.len());
        used().count() > 0
            && others.all(|frame| frame.used == 0)
            && (self.frames.iter().zip(&reference.frames))
                .all(|(allowed, asked)| asked.used == 0 || allowed.can(asked))
    }

    /// The frames with which the mode begins are near where they are led to.
    pub(super) fn begins_near(&mut self, reference: &Reference, measured: &MeasuredRecord) -> bool {
        self.began = reference.frames.map(|frame| (frame.used, frame.own_axes));
        let Some(placements) = &mut self.placements else {
            return false;
        };
        placements.set(&measured.joints);
        (self.frames.iter().zip(&reference.frames)).all(|(allowed, asked)| {
            let p = &allowed.parameters;
            let (wanted, present) = (pose(asked), placements.between(p.base, p.link));
            let linear = (wanted.translation - present.translation).norm();
            let between = wanted.rotation * present.rotation.transpose();
            let [v, w] = p.limits.velocity.map(|most| most * FIRST_DISTANCE_S);
            asked.used == 0 || (linear <= v && unit_quaternion(&between).angle() <= w)
        })
    }

    /// The reference has the frames and the axes with which the mode began: one more or less would be a step.
    pub(super) fn goes_on(&self, reference: &Reference) -> bool {
        self.began == reference.frames.map(|frame| (frame.used, frame.own_axes))
    }
}

impl Allowed {
    fn new(parameters: &FrameParameters, model: &Model) -> Self {
        let frames = model.frames();
        let (from, mut body) = (frames[parameters.base].body, frames[parameters.link].body);
        let mut reach = frames[parameters.link].placement.translation.norm()
            + frames[parameters.base].placement.translation.norm();
        while body != from
            && let Some(parent) = model.parent(body)
        {
            let own = &model.bodies()[body];
            let way = if own.kind.is_revolute() {
                0.0
            } else {
                (model.joint_limits(own.joint)).map_or(0.0, |limits| {
                    limits.lower.abs().max(limits.upper.abs()) * own.ratio.abs()
                })
            };
            reach += own.placement.translation.norm() + way;
            body = parent;
        }
        Self {
            parameters: parameters.clone(),
            reach,
        }
    }

    fn can(&self, asked: &FrameReference) -> bool {
        let limits = &self.parameters.limits;
        let parts = |x: &[f64; 6]| {
            let x = Vector6::from(*x);
            [0, 3].map(|k| x.fixed_rows::<3>(k).norm())
        };
        let below = |x: &[f64; 6], most: [f64; 2]| {
            let [linear, angular] = parts(x);
            linear <= most[0] * ROUNDING && angular <= most[1] * ROUNDING
        };
        let stiffness = asked.stiffness.iter().enumerate();
        let axes = 0..6u32;
        let length = asked.orientation.iter().map(|x| x * x).sum::<f64>().sqrt();
        asked.used == 1
            && asked.own_axes <= 1
            && asked.force_axes < 1 << 6
            && (length - 1.0).abs() <= QUATERNION
            && Vector3::from(asked.position).norm() <= self.reach * ROUNDING
            && below(&asked.velocity, limits.velocity)
            && below(&asked.force, limits.wrench)
            && DAMPING_RATIOS.contains(&asked.damping_ratio)
            && (stiffness.clone())
                .all(|(i, k)| (0.0..=limits.stiffness[i / 3] * ROUNDING).contains(k))
            && (axes.zip(&asked.stiffness))
                .all(|(i, k)| asked.force_axes >> i & 1 == 0 || *k == 0.0)
    }
}

/// The desired pose.
pub(super) fn pose(asked: &FrameReference) -> Se3 {
    let [w, x, y, z] = asked.orientation;
    let orientation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let rotation = orientation.to_rotation_matrix().into_inner();
    Se3::new(rotation, Vector3::from(asked.position))
}
