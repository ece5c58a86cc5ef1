//! The demo's motion: slow sinusoids around the pose in which the robot starts.

use std::f64::consts::TAU;

use problem::{Problem, line_at, listed};
use robot_config::{JointParameters, Robot};
use robot_state::{JointKind, JointReference};
use serde::Deserialize;
use supervisor::Limits;

/// Motion of a joint without a motion file: share of its range, at most so far (rad), and shortest
/// period, s. A prismatic joint moves as far as a hand does by a forearm's length at that angle.
const DEFAULT_SHARE: f64 = 0.1;
const DEFAULT_AMPLITUDE: f64 = TAU / 36.0;
const DEFAULT_WAY: f64 = 0.05;
const DEFAULT_PERIOD: f64 = 5.0;

/// A motion file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionFile {
    settle_s: f64,
    #[serde(default)]
    mode: MotionMode,
    #[serde(default)]
    stance: Vec<String>,
    #[serde(default)]
    joint: Vec<JointMotion>,
    #[serde(default)]
    contact: Vec<ContactMotion>,
}

/// Mode in which the robot follows the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum MotionMode {
    /// Inverse dynamics; what the stance carries is the demo's.
    #[default]
    InverseDynamics,
    /// Stand: the daemon keeps the robot in balance over its feet.
    Stand,
}

/// A desired torque about a foot's vertical axis, beside the wrench that carries the weight.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct ContactMotion {
    name: String,
    #[serde(rename = "torque_z_Nm")]
    torque_z: f64,
    period_s: f64,
}

/// Motion of one joint: `q_d = start + amplitude (1 - cos(2 pi t / period)) / 2`; several of one joint
/// add up.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct JointMotion {
    name: String,
    amplitude_deg: Option<f64>,
    amplitude_mm: Option<f64>,
    period_s: f64,
}

impl JointMotion {
    /// The amplitude of a joint of that kind, rad or m.
    fn amplitude(&self, kind: JointKind) -> Result<f64, Problem> {
        let (own, other) = match kind {
            JointKind::Revolute => (self.amplitude_deg, self.amplitude_mm),
            JointKind::Prismatic => (self.amplitude_mm, self.amplitude_deg),
        };
        let finite = own.filter(|own| own.is_finite() && other.is_none());
        finite.map(|own| kind.si(own)).ok_or_else(|| {
            let what = format!(
                "joint {}: its amplitude; the joint is {}",
                self.name,
                kind.name()
            );
            let allowed = format!("a finite {}", kind.units("amplitude_deg"));
            Problem::new(what, allowed)
        })
    }
}

/// One joint's motion.
#[derive(Debug, Clone, Default)]
struct Swing {
    /// q_d at the start, rad.
    start: f64,
    /// (amplitude, period) of what adds up, rad and s.
    parts: Vec<(f64, f64)>,
}

/// Slow motion of some joints from a start pose.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Time at rest before the motion begins, s.
    pub(super) settle_s: f64,
    /// Mode in which the robot follows it.
    pub(super) mode: MotionMode,
    /// F/T sensors whose end-effectors carry the robot's weight.
    pub(super) stance: Vec<String>,
    /// Each joint in config order.
    joints: Vec<Swing>,
    /// Middle of each joint's range, rad: towards it the joints move; empty if the signs are given.
    middle: Vec<f64>,
    contacts: Vec<ContactMotion>,
}

impl Motion {
    /// Reads a motion file for joints of these names and kinds.
    ///
    /// # Errors
    /// A key or value that is not allowed, with the file.
    pub fn parse(
        text: &str,
        file_name: &str,
        of_robot: &[(String, JointKind)],
    ) -> Result<Self, Problem> {
        let file: MotionFile = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(0, |span| line_at(text, span.start));
            Problem::new(e.message(), "").at(file_name, line)
        })?;
        if file.mode == MotionMode::Stand && !(file.stance.is_empty() && file.contact.is_empty()) {
            let reason = "mode \"stand\" beside a stance or a contact";
            return Err(
                Problem::new(reason, "the daemon finds what the feet carry").at(file_name, 0)
            );
        }
        let mut joints = vec![Swing::default(); of_robot.len()];
        for motion in &file.joint {
            let index = of_robot.iter().position(|(name, _)| *name == motion.name);
            let index = index.ok_or_else(|| {
                let reason = format!("joint.name: there is no joint {:?}", motion.name);
                let names = listed(of_robot.iter().map(|(name, _)| name.as_str()));
                Problem::new(reason, names).at(file_name, 0)
            })?;
            let amplitude = motion.amplitude(of_robot[index].1);
            let amplitude = amplitude.map_err(|problem| problem.at(file_name, 0))?;
            if motion.period_s.is_nan() || motion.period_s <= 0.0 {
                let reason = format!("joint {}: period_s", motion.name);
                return Err(Problem::new(reason, "a period above 0").at(file_name, 0));
            }
            joints[index].parts.push((amplitude, motion.period_s));
        }
        Ok(Self {
            settle_s: file.settle_s,
            mode: file.mode,
            stance: file.stance,
            joints,
            middle: Vec::new(),
            contacts: file.contact,
        })
    }

    /// Every joint by a share of its range, each with another period, so that all are loaded in
    /// changing ways.
    pub(super) fn of_every_joint(robot: &Robot) -> Self {
        let joints = &robot.parameters.joints;
        let middle = |limits: &Limits| 0.5 * (limits.position_min + limits.position_max);
        let joint = |(j, joint): (usize, &JointParameters)| {
            let limits = &joint.limits;
            let range = limits.position_max - limits.position_min;
            let amplitude = (DEFAULT_SHARE * range).min(match joint.kind {
                JointKind::Revolute => DEFAULT_AMPLITUDE,
                JointKind::Prismatic => DEFAULT_WAY,
            });
            Swing {
                start: 0.0,
                parts: vec![(amplitude, DEFAULT_PERIOD + 0.7 * (j % 6) as f64)],
            }
        };
        Self {
            settle_s: 1.0,
            mode: MotionMode::default(),
            stance: Vec::new(),
            joints: joints.iter().enumerate().map(joint).collect(),
            middle: joints.iter().map(|joint| middle(&joint.limits)).collect(),
            contacts: Vec::new(),
        }
    }

    /// Makes `q` (rad, config order) the pose from which the motion starts.
    pub(super) fn start_from(&mut self, q: &[f64]) {
        for (joint, &q) in self.joints.iter_mut().zip(q) {
            joint.start = q;
        }
        for (joint, middle) in self.joints.iter_mut().zip(&self.middle) {
            let start = joint.start;
            let parts = joint.parts.iter_mut();
            parts.for_each(|(amplitude, _)| *amplitude = amplitude.copysign(middle - start));
        }
    }

    /// Torque about the vertical axis of the end-effector beyond F/T sensor `name` at `t`, s since
    /// the start, N·m.
    #[must_use]
    pub(super) fn contact_torque(&self, name: &str, t: f64) -> f64 {
        let contacts = self.contacts.iter().filter(|contact| contact.name == name);
        let since = (t - self.settle_s).max(0.0);
        contacts
            .map(|c| 0.5 * c.torque_z * (1.0 - (TAU / c.period_s * since).cos()))
            .sum()
    }

    /// Desired motion of a joint at `t`, s since the start.
    #[must_use]
    pub(super) fn at(&self, joint: usize, t: f64) -> JointReference {
        let swing = &self.joints[joint];
        let since = (t - self.settle_s).max(0.0);
        let moves = f64::from(t >= self.settle_s);
        let mut reference = JointReference {
            q_d: swing.start,
            ..JointReference::default()
        };
        for (amplitude, period) in &swing.parts {
            let (omega, half) = (TAU / period, 0.5 * amplitude);
            let phase = omega * since;
            reference.q_d += half * (1.0 - phase.cos());
            reference.dq_d += half * omega * phase.sin();
            reference.ddq_d += moves * half * omega * omega * phase.cos();
        }
        reference
    }
}

#[cfg(test)]
mod tests {
    use super::{JointKind, Motion};

    const TEXT: &str =
        "settle_s = 1.0\n[[joint]]\nname = \"b\"\namplitude_deg = 20.0\nperiod_s = 4.0\n";
    const FASTER: &str = "[[joint]]\nname = \"b\"\namplitude_deg = -5.0\nperiod_s = 0.7\n";

    fn names() -> Vec<(String, JointKind)> {
        vec![
            ("a".into(), JointKind::Prismatic),
            ("b".into(), JointKind::Revolute),
        ]
    }

    #[test]
    fn prismatic_joints_move_by_mm() {
        let text = "settle_s = 0.0\n[[joint]]\nname = \"a\"\namplitude_mm = 30.0\nperiod_s = 4.0\n";
        let motion = Motion::parse(text, "m.toml", &names()).unwrap();
        assert!((motion.at(0, 2.0).q_d - 0.03).abs() < 1e-12);
        let error = Motion::parse(&text.replace("_mm", "_deg"), "m.toml", &names());
        let error = error.unwrap_err().to_string();
        assert!(
            error.contains("prismatic") && error.contains("amplitude_mm"),
            "{error}"
        );
        assert!(Motion::parse(&text.replace("\"a\"", "\"b\""), "m.toml", &names()).is_err());
    }

    #[test]
    fn velocity_and_acceleration_are_derivatives_of_position() {
        let both = format!("{TEXT}{FASTER}");
        let mut sum = Motion::parse(&both, "motion.toml", &names()).unwrap();
        sum.start_from(&[0.3, -0.5]);
        let mut motion = Motion::parse(TEXT, "motion.toml", &names()).unwrap();
        motion.start_from(&[0.3, -0.5]);
        let h = 1e-4;
        for i in 0..60 {
            let t = 1.05 + 0.13 * f64::from(i);
            let [before, now, after] = [t - h, t, t + h].map(|t| motion.at(1, t));
            assert!(((after.q_d - before.q_d) / (2.0 * h) - now.dq_d).abs() < 1e-7);
            assert!(((after.dq_d - before.dq_d) / (2.0 * h) - now.ddq_d).abs() < 1e-7);
            let [before, both, after] = [t - h, t, t + h].map(|t| sum.at(1, t));
            assert!(((after.q_d - before.q_d) / (2.0 * h) - both.dq_d).abs() < 1e-5);
            assert!(((after.dq_d - before.dq_d) / (2.0 * h) - both.ddq_d).abs() < 1e-4);
            assert_eq!(motion.at(0, t).q_d, 0.3);
        }
        assert_eq!(motion.at(1, 0.5).q_d, -0.5);
        assert!((motion.at(1, 3.0).q_d - (-0.5 + 20f64.to_radians())).abs() < 1e-12);
        assert!((sum.at(1, 3.8).q_d - motion.at(1, 3.8).q_d).abs() < 1e-12);
    }

    #[test]
    fn without_a_file_every_joint_moves_towards_the_middle_of_its_range() {
        let robot = robot_config::load("config/leg/robot.toml", &super::super::robots::read);
        let robot = robot.unwrap();
        let mut motion = Motion::of_every_joint(&robot);
        let joints = &robot.parameters.joints;
        let upper: Vec<f64> = joints.iter().map(|j| j.limits.position_max).collect();
        motion.start_from(&upper);
        for (j, joint) in joints.iter().enumerate() {
            for t in (0..200).map(|i| 0.1 * f64::from(i)) {
                let q = motion.at(j, t).q_d;
                assert!(
                    (joint.limits.position_min..=upper[j]).contains(&q),
                    "{}",
                    joint.name
                );
            }
            assert!(
                (motion.at(j, 4.0).q_d - upper[j]).abs() > 0.01,
                "{}",
                joint.name
            );
        }
    }

    #[test]
    fn unknown_joints_and_keys_are_refused() {
        let error = Motion::parse(&TEXT.replace("\"b\"", "\"c\""), "m.toml", &names())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("m.toml") && error.contains("a, b"),
            "{error}"
        );
        let error = Motion::parse("settle_s = 1.0\nmode = \"walk\"", "m.toml", &names());
        let error = error.unwrap_err().to_string();
        assert!(
            error.contains("m.toml:2") && error.contains("stand"),
            "{error}"
        );
        let twice = "settle_s = 1.0\nmode = \"stand\"\nstance = [\"left_ankle\"]";
        let error = Motion::parse(twice, "m.toml", &names()).unwrap_err();
        assert!(error.to_string().contains("stance"), "{error}");
        let error = Motion::parse("settle = 1.0", "m.toml", &names())
            .unwrap_err()
            .to_string();
        assert!(error.contains("settle_s"), "{error}");
    }
}
