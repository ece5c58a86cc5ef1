//! A robot and its logs, as the fits see them.

use dynamics::Model;

/// Logged columns of a joint, SI units.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointColumns {
    /// q: joint angle, rad or m.
    pub q: Vec<f64>,
    /// dq: joint velocity, rad/s or m/s; empty where the log has none.
    pub dq: Vec<f64>,
    /// ddq: joint acceleration; empty where the log has none.
    pub ddq: Vec<f64>,
    /// tau: joint torque, N·m or N.
    pub tau: Vec<f64>,
}

/// A log of a robot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RobotLog {
    /// The file's name, for messages.
    pub name: String,
    /// Stamps, s.
    pub t: Vec<f64>,
    /// Columns of each joint of the model; none for a joint at rest at its neutral angle.
    pub joints: Vec<Option<JointColumns>>,
}

/// The robot as the fits see it.
#[derive(Debug)]
pub struct Robot<'a> {
    /// Its rigid bodies on a base that stands still.
    pub model: &'a Model,
    /// Joints that have a torque, as indices of the model's.
    pub measured: Vec<usize>,
    /// q of all joints of the model where no log moves them: the middle of ranges without zero.
    pub rest: Vec<f64>,
    /// Torques are those of the motors, as from their currents: rotors are a part of them.
    pub motor_torque: bool,
    /// Columns that contradict the URDF are taken as they stand.
    pub accept: bool,
    /// Bodies that move.
    pub bodies: usize,
    /// For each measured joint the bodies, from 0, that its torque moves.
    pub carried: Vec<Vec<usize>>,
}

impl<'a> Robot<'a> {
    /// The robot whose logs have torques of the `measured` joints.
    #[must_use]
    pub fn new(model: &'a Model, measured: &[usize]) -> Self {
        let bodies = model.bodies();
        let drives = |joint: usize, body: usize| {
            let mut at = Some(body);
            while let Some(b) = at.filter(|b| *b > 0) {
                if bodies[b].joint == joint {
                    return true;
                }
                at = model.parent(b);
            }
            false
        };
        let carried = |joint: &usize| {
            let all = 1..bodies.len();
            all.filter(|b| drives(*joint, *b)).map(|b| b - 1).collect()
        };
        let rest = |j: &dynamics::Joint| match (j.limits.lower, j.limits.upper) {
            (lower, upper) if lower <= 0.0 && upper >= 0.0 => 0.0,
            (lower, upper) => 0.5 * (lower + upper),
        };
        Self {
            model,
            rest: model.joints().iter().map(rest).collect(),
            measured: measured.to_vec(),
            motor_torque: false,
            accept: false,
            bodies: bodies.len() - 1,
            carried: measured.iter().map(carried).collect(),
        }
    }

    /// Name of a measured joint.
    #[must_use]
    pub fn name(&self, joint: usize) -> &str {
        &self.model.joints()[self.measured[joint]].name
    }

    /// Name of the link that a body's joint carries.
    #[must_use]
    pub fn link(&self, body: usize) -> &str {
        let frames = self.model.frames().iter();
        let mut own = frames.filter(|f| f.body == body + 1 && !f.rigid);
        own.next().map_or("", |f| f.name.as_str())
    }

    /// Unit of a measured joint's torque.
    #[must_use]
    pub fn unit(&self, joint: usize) -> &'static str {
        if self.model.joints()[self.measured[joint]].kind.is_revolute() {
            "N·m"
        } else {
            "N"
        }
    }
}
