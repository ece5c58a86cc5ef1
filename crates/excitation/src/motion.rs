//! From the parts of a plan to the points of a trajectory: sampled, from rest to rest, continuous up
//! to the acceleration.

use crate::jet::{Jet, window};
use crate::multisine::{self, Choice};
use crate::plan::{Angles, Constant, Kind, Part};
use control::{MotionLimits, PlannedMotion, PointToPoint};
use problem::Problem;
use robot_config::Robot;
use robot_state::JointKind;
use std::f64::consts::TAU;

/// Time between two points, s: the loop interpolates between them.
pub const SPACING_S: f64 = 0.004;
/// A sweep stays this far from the position limits where it names no ends, rad; of prismatic joints
/// the way that counts as much.
const MARGIN: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Rest between two parts, s.
const REST_S: f64 = 0.5;
/// Longest trajectory, s.
const LONGEST_S: f64 = 7200.0;

/// A stretch of a trajectory.
#[derive(Debug, Clone)]
pub struct Span {
    /// Part and joints.
    pub title: String,
    /// Its points.
    pub points: std::ops::Range<usize>,
}

/// A trajectory of all joints.
#[derive(Debug, Clone, Default)]
pub struct Motion {
    joints: usize,
    /// The points, one after the other, of all joints.
    points: Vec<PlannedMotion>,
    /// Its parts.
    pub spans: Vec<Span>,
    /// Choices made for multisines.
    pub choices: Vec<Choice>,
}

impl Motion {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len() / self.joints.max(1)
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// From the first point to the last, s.
    pub fn duration(&self) -> f64 {
        self.len().saturating_sub(1) as f64 * SPACING_S
    }

    /// All joints at a point; the last one beyond the end.
    pub fn point(&self, index: usize) -> &[PlannedMotion] {
        let index = index.min(self.len().saturating_sub(1)) * self.joints;
        self.points.get(index..index + self.joints).unwrap_or(&[])
    }

    /// All joints at the point nearest to a time.
    pub fn at(&self, t: f64) -> &[PlannedMotion] {
        self.point((t / SPACING_S).round().max(0.0) as usize)
    }

    /// Action at a point.
    pub fn title(&self, index: usize) -> &str {
        let span = self.spans.iter().find(|span| span.points.contains(&index));
        span.map_or("", |span| &span.title)
    }
}

/// The parts of a plan one after the other from a pose, rad or m, which the joints have in the end again.
///
/// # Errors
/// A part that cannot be planned.
pub(crate) fn plan(
    robot: &Robot,
    parts: &[Part],
    pose: &[f64],
    progress: &mut dyn FnMut(&str),
) -> Result<Motion, Problem> {
    let mut builder = Builder::new(robot, pose);
    builder.rest(REST_S, "rest");
    for part in parts {
        builder.part(part, progress)?;
        if builder.motion.duration() > LONGEST_S {
            let what = format!("the plan lasts longer than {LONGEST_S} s");
            return Err(Problem::new(what, "several plans"));
        }
    }
    let pose = builder.pose.clone();
    builder.go_to(&pose, "back")?;
    builder.rest(REST_S, "rest");
    Ok(builder.motion)
}

/// The way that the loop plans from one pose to another in mode position.
pub(crate) fn approach(robot: &Robot, from: &[f64], to: &[f64]) -> Result<Motion, Problem> {
    let mut builder = Builder::new(robot, from);
    builder.go_to(to, "approach")?;
    Ok(builder.motion)
}

struct Builder<'a> {
    robot: &'a Robot,
    limits: Vec<MotionLimits>,
    pose: Vec<f64>,
    now: Vec<f64>,
    motion: Motion,
}

impl<'a> Builder<'a> {
    fn new(robot: &'a Robot, pose: &[f64]) -> Self {
        let rest = |q: &f64| PlannedMotion {
            q: *q,
            ..PlannedMotion::default()
        };
        Self {
            robot,
            limits: robot.parameters.motion_limits().collect(),
            pose: pose.to_vec(),
            now: pose.to_vec(),
            motion: Motion {
                joints: pose.len(),
                points: pose.iter().map(rest).collect(),
                ..Motion::default()
            },
        }
    }

    fn joint(&self, name: &str) -> Result<usize, Problem> {
        let mut joints = self.robot.parameters.joints.iter();
        let found = joints.position(|joint| joint.name == name);
        found.ok_or_else(|| Problem::new(format!("the robot has no joint {name:?}"), ""))
    }

    fn kind(&self, joint: usize) -> JointKind {
        self.robot.parameters.joints[joint].kind
    }

    fn with(&self, pose: &[f64], angles: &Angles) -> Result<Vec<f64>, Problem> {
        let mut pose = pose.to_vec();
        for (name, angle) in angles {
            let joint = self.joint(name)?;
            pose[joint] = self.kind(joint).si(*angle);
        }
        Ok(pose)
    }

    fn span(&mut self, title: &str, first: usize) {
        let points = first..self.motion.len();
        if !points.is_empty() {
            let title = title.to_owned();
            self.motion.spans.push(Span { title, points });
        }
    }

    fn push(&mut self, point: impl IntoIterator<Item = PlannedMotion>) {
        self.motion.points.extend(point);
    }

    fn rest(&mut self, seconds: f64, title: &str) {
        let first = self.motion.len();
        for _ in 0..(seconds / SPACING_S).ceil() as usize {
            let rest = self.now.iter().map(|&q| PlannedMotion {
                q,
                ..PlannedMotion::default()
            });
            self.motion.points.extend(rest);
        }
        self.span(title, first);
    }

    fn go_to(&mut self, target: &[f64], title: &str) -> Result<(), Problem> {
        let limits = self.limits.clone();
        self.go_within(target, &limits, title)
    }

    /// To a pose, all joints at once, within these limits.
    fn go_within(
        &mut self,
        target: &[f64],
        limits: &[MotionLimits],
        title: &str,
    ) -> Result<(), Problem> {
        if self.now == target {
            return Ok(());
        }
        let first = self.motion.len();
        let mut motion = PointToPoint::new(target.len());
        motion.start(self.now.iter().map(|&q| PlannedMotion {
            q,
            ..PlannedMotion::default()
        }));
        let ways = target.iter().copied().zip(limits.iter().copied());
        if !motion.go_to(ways) {
            let what = format!("{title}: there is no such motion");
            return Err(Problem::new(
                what,
                "angles within the limits, a higher speed",
            ));
        }
        while motion.left_s() > 0.0 {
            let point = motion.advance(SPACING_S).to_vec();
            self.push(point);
        }
        self.now.copy_from_slice(target);
        self.span(title, first);
        Ok(())
    }

    /// Some joints move about where they are, for `duration`, and are back then.
    fn signal(&mut self, duration: f64, title: &str, mut at: impl FnMut(f64, &mut [Jet])) {
        let first = self.motion.len();
        let mut jets = vec![Jet::default(); self.now.len()];
        for k in 1..=(duration / SPACING_S).ceil() as usize {
            jets.fill(Jet::default());
            at((k as f64 * SPACING_S).min(duration), &mut jets);
            let joints = self.now.iter().zip(&jets);
            let point = joints.map(|(q, jet)| PlannedMotion {
                q: q + jet.0,
                dq: jet.1,
                ddq: jet.2,
            });
            self.motion.points.extend(point);
        }
        self.span(title, first);
    }

    fn part(&mut self, part: &Part, progress: &mut dyn FnMut(&str)) -> Result<(), Problem> {
        let title = part.title();
        progress(&format!("planning {title}"));
        let pose = self.with(&self.pose, &part.pose)?;
        self.go_to(&pose, "way")?;
        self.rest(REST_S, "rest");
        let joints = (part.joints.iter())
            .map(|name| self.joint(name))
            .collect::<Result<Vec<_>, _>>()?;
        match part.kind {
            Kind::Poses => {
                for angles in &part.poses {
                    let target = self.with(&pose, angles)?;
                    self.go_to(&target, "way")?;
                    self.rest(part.hold_s.unwrap_or(1.0), &title);
                }
                return Ok(());
            }
            Kind::Multisine => {
                let found = multisine::choose(self.robot, part, &joints, &pose, progress)?;
                self.signal(found.duration, &title, |t, jets| found.signals.at(t, jets));
                self.motion.choices.push(found.choice);
                return Ok(());
            }
            _ => {}
        }
        let groups: Vec<Vec<usize>> = if part.together {
            vec![joints]
        } else {
            joints.into_iter().map(|joint| vec![joint]).collect()
        };
        for group in groups {
            self.group(part, &group)?;
            self.go_to(&pose, "way")?;
            self.rest(REST_S, "rest");
        }
        Ok(())
    }

    /// The joints of a group at once.
    fn group(&mut self, part: &Part, joints: &[usize]) -> Result<(), Problem> {
        let names = joints
            .iter()
            .map(|j| self.robot.parameters.joints[*j].name.as_str());
        let title = format!("{}: {}", part.title(), names.collect::<Vec<_>>().join(", "));
        if part.kind == Kind::Sweep {
            return self.sweep(part, joints, &title);
        }
        // The joints of such a part are all of one kind.
        let kind = joints
            .first()
            .map_or(JointKind::Revolute, |j| self.kind(*j));
        let amplitude = part.amplitude(kind).unwrap_or(0.0);
        let duration = part.duration_s.unwrap_or(0.0);
        let (from, to) = (part.from_hz.unwrap_or(1.0), part.to_hz.unwrap_or(1.0));
        let frequency = part.frequency_hz.unwrap_or(1.0);
        let constant = part.constant.unwrap_or_default();
        let chirps = part.kind == Kind::Chirp;
        let within = |time: f64| time.min(0.25 * duration);
        let fades = if chirps {
            (within(1.0 / from), within(3.0 / to))
        } else {
            (within(1.0 / frequency), within(1.0 / frequency))
        };
        self.signal(duration, &title, |t, jets| {
            let signal = if chirps {
                chirp(t, duration, fades, (from, to), constant)
            } else {
                Jet(TAU * frequency * t, TAU * frequency, 0.0)
                    .sin()
                    .times(Jet(t / duration, 1.0 / duration, 0.0))
            };
            let jet = signal.times(window(t, duration, fades)).scaled(amplitude);
            for joint in joints {
                jets[*joint] = jet;
            }
        });
        Ok(())
    }

    fn sweep(&mut self, part: &Part, joints: &[usize], title: &str) -> Result<(), Problem> {
        let mut limits = self.limits.clone();
        let (mut low, mut high) = (self.now.clone(), self.now.clone());
        for &j in joints {
            let position = &self.robot.parameters.joints[j].limits;
            let kind = self.kind(j);
            let margin = kind.threshold(MARGIN);
            low[j] = part.from(kind).unwrap_or(position.position_min + margin);
            high[j] = part.to(kind).unwrap_or(position.position_max - margin);
            let speed = part.speed(kind).unwrap_or_else(|| kind.si(1.0));
            let own = &mut limits[j];
            own.velocity = own.velocity.min(speed);
            // Full speed within 0.2 s, so that most of the way is at that speed.
            own.acceleration = own.acceleration.min(5.0 * speed);
            own.jerk = own.jerk.min(10.0 * own.acceleration);
        }
        self.go_to(&low, "way")?;
        for _ in 0..part.times.unwrap_or(1) {
            self.rest(REST_S, "rest");
            self.go_within(&high, &limits, title)?;
            self.rest(REST_S, "rest");
            self.go_within(&low, &limits, title)?;
        }
        Ok(())
    }
}

/// A sinusoid whose frequency changes by equal shares in equal times: the first one, and amplitude 1,
/// where it has been faded in, the last one where it begins to be faded out.
fn chirp(
    t: f64,
    duration: f64,
    fades: (f64, f64),
    (from, to): (f64, f64),
    constant: Constant,
) -> Jet {
    let rate = (to / from).ln() / (duration - fades.0 - fades.1);
    let t = t - fades.0;
    let share = Jet(rate * t, rate, 0.0).exp();
    let phase = if rate.abs() > 1e-9 {
        let k = TAU * from / rate;
        Jet(k * (share.0 - 1.0), k * share.1, k * share.2)
    } else {
        Jet(TAU * from * t, TAU * from, 0.0)
    };
    let power = match constant {
        Constant::Position => 0.0,
        Constant::Velocity => 1.0,
        Constant::Acceleration => 2.0,
    };
    let size = Jet(-power * rate * t, -power * rate, 0.0).exp();
    phase.sin().times(size)
}
