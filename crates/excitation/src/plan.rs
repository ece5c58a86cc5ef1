//! The plan's file: TOML.

use problem::{Problem, Problems, line_at, listed};
use robot_config::Robot;
use robot_state::JointKind;
use serde::Deserialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use toml::Spanned;

/// Positions by joint, in degrees, of prismatic joints in mm.
pub type Angles = BTreeMap<String, f64>;

/// A plan as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// The robot's configuration, relative to the plan.
    pub config: String,
    /// Where joints are before, between and after the parts; others stay.
    #[serde(default)]
    pub pose: Angles,
    /// Hulls for the self-distance, where the URDF has none.
    #[serde(default)]
    pub self_distance: Option<SelfDistance>,
    /// The parts, one after the other.
    #[serde(default, rename = "part")]
    pub parts: Vec<Spanned<Part>>,
}

/// Hulls for the self-distance.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelfDistance {
    /// Radius of the capsules from joint to joint, for a robot whose URDF has no collision geometry, m.
    #[serde(default)]
    pub radius_m: Option<f64>,
    /// The same for the bodies beyond single joints, m.
    #[serde(default)]
    pub radii_m: BTreeMap<String, f64>,
    /// Least distance, m.
    #[serde(default = "clearance")]
    pub least_m: f64,
}

fn clearance() -> f64 {
    0.02
}

/// Kind of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Both ways at one slow speed.
    Sweep,
    /// A sinusoid that grows from nothing (D 3.4.2).
    GrowingSine,
    /// A sinusoid whose frequency rises.
    Chirp,
    /// A sum of sinusoids of several joints, chosen for inertial parameters.
    Multisine,
    /// Poses at rest.
    Poses,
}

/// Quantity that stays the same as a chirp's frequency rises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Constant {
    /// The amplitude of the position.
    Position,
    /// That of the velocity.
    #[default]
    Velocity,
    /// That of the acceleration.
    Acceleration,
}

/// One part of a plan: what its kind needs.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Kind of the motion.
    pub kind: Kind,
    /// A name for reports.
    #[serde(default)]
    pub name: Option<String>,
    /// The joints that it moves.
    #[serde(default)]
    pub joints: Vec<String>,
    /// All joints at the same time, not one after the other.
    #[serde(default)]
    pub together: bool,
    /// Where joints are during this part, beside the plan's pose.
    #[serde(default)]
    pub pose: Angles,
    /// Lower end of a sweep, degrees.
    #[serde(default)]
    pub from_deg: Option<f64>,
    /// Upper end of a sweep, degrees.
    #[serde(default)]
    pub to_deg: Option<f64>,
    /// Lower end of a sweep of a prismatic joint, mm.
    #[serde(default)]
    pub from_mm: Option<f64>,
    /// Upper end of a sweep of a prismatic joint, mm.
    #[serde(default)]
    pub to_mm: Option<f64>,
    /// Speed of a sweep, degrees/s.
    #[serde(default)]
    pub speed_deg_per_s: Option<f64>,
    /// Speed of a sweep of a prismatic joint, mm/s.
    #[serde(default)]
    pub speed_mm_per_s: Option<f64>,
    /// Number of sweeps each way.
    #[serde(default)]
    pub times: Option<u32>,
    /// Greatest amplitude of a sine or chirp, degrees.
    #[serde(default)]
    pub amplitude_deg: Option<f64>,
    /// Greatest amplitude of a sine or chirp of a prismatic joint, mm.
    #[serde(default)]
    pub amplitude_mm: Option<f64>,
    /// Frequency of a sine, or the lowest one of a multisine, Hz.
    #[serde(default)]
    pub frequency_hz: Option<f64>,
    /// Frequency with which a chirp begins, Hz.
    #[serde(default)]
    pub from_hz: Option<f64>,
    /// Frequency with which a chirp ends, Hz.
    #[serde(default)]
    pub to_hz: Option<f64>,
    /// Duration of a sine, chirp or multisine, s.
    #[serde(default)]
    pub duration_s: Option<f64>,
    /// Quantity that stays the same in a chirp.
    #[serde(default)]
    pub constant: Option<Constant>,
    /// Number of sinusoids of each joint of a multisine.
    #[serde(default)]
    pub harmonics: Option<u32>,
    /// Seed of a multisine's signals.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Number of signals among which a multisine is chosen.
    #[serde(default)]
    pub tries: Option<u32>,
    /// Share of the position range that a multisine may use, %.
    #[serde(default)]
    pub position_per_cent: Option<f64>,
    /// Share of the velocity limit that a multisine may use, %.
    #[serde(default)]
    pub velocity_per_cent: Option<f64>,
    /// Share of the torque limit that a multisine may use, %.
    #[serde(default)]
    pub torque_per_cent: Option<f64>,
    /// Poses at rest, one after the other.
    #[serde(default)]
    pub poses: Vec<Angles>,
    /// Time at rest in each pose, s.
    #[serde(default)]
    pub hold_s: Option<f64>,
}

impl Part {
    /// A part without any number yet.
    #[must_use]
    pub fn of(kind: Kind, joints: Vec<String>) -> Self {
        Self {
            kind,
            name: None,
            joints,
            together: false,
            pose: Angles::new(),
            from_deg: None,
            to_deg: None,
            from_mm: None,
            to_mm: None,
            speed_deg_per_s: None,
            speed_mm_per_s: None,
            times: None,
            amplitude_deg: None,
            amplitude_mm: None,
            frequency_hz: None,
            from_hz: None,
            to_hz: None,
            duration_s: None,
            constant: None,
            harmonics: None,
            seed: None,
            tries: None,
            position_per_cent: None,
            velocity_per_cent: None,
            torque_per_cent: None,
            poses: Vec::new(),
            hold_s: None,
        }
    }

    /// Its name, or its kind.
    pub fn title(&self) -> String {
        let kind = match self.kind {
            Kind::Sweep => "sweep",
            Kind::GrowingSine => "growing_sine",
            Kind::Chirp => "chirp",
            Kind::Multisine => "multisine",
            Kind::Poses => "poses",
        };
        self.name.clone().unwrap_or_else(|| kind.to_owned())
    }

    /// The lower end of a sweep of joints of this kind, rad or m.
    pub fn from(&self, kind: JointKind) -> Option<f64> {
        si(kind, self.from_deg, self.from_mm)
    }

    /// The upper end of a sweep, rad or m.
    pub fn to(&self, kind: JointKind) -> Option<f64> {
        si(kind, self.to_deg, self.to_mm)
    }

    /// The speed of a sweep, rad/s or m/s.
    pub fn speed(&self, kind: JointKind) -> Option<f64> {
        si(kind, self.speed_deg_per_s, self.speed_mm_per_s)
    }

    /// The amplitude of a sine or chirp, rad or m.
    pub fn amplitude(&self, kind: JointKind) -> Option<f64> {
        si(kind, self.amplitude_deg, self.amplitude_mm)
    }

    /// This part with that amplitude, rad or m.
    pub fn with_amplitude(self, kind: JointKind, amplitude: f64) -> Self {
        let shown = Some(kind.shown(amplitude));
        match kind {
            JointKind::Revolute => Self {
                amplitude_deg: shown,
                ..self
            },
            JointKind::Prismatic => Self {
                amplitude_mm: shown,
                ..self
            },
        }
    }

    /// Keys with numbers that this part gives.
    fn given(&self) -> Vec<(&'static str, f64)> {
        let keys = [
            ("from_deg", self.from_deg),
            ("to_deg", self.to_deg),
            ("from_mm", self.from_mm),
            ("to_mm", self.to_mm),
            ("speed_deg_per_s", self.speed_deg_per_s),
            ("speed_mm_per_s", self.speed_mm_per_s),
            ("times", self.times.map(f64::from)),
            ("amplitude_deg", self.amplitude_deg),
            ("amplitude_mm", self.amplitude_mm),
            ("frequency_hz", self.frequency_hz),
            ("from_hz", self.from_hz),
            ("to_hz", self.to_hz),
            ("duration_s", self.duration_s),
            ("harmonics", self.harmonics.map(f64::from)),
            ("seed", self.seed.map(|seed| seed as f64)),
            ("tries", self.tries.map(f64::from)),
            ("position_per_cent", self.position_per_cent),
            ("velocity_per_cent", self.velocity_per_cent),
            ("torque_per_cent", self.torque_per_cent),
            ("hold_s", self.hold_s),
        ];
        let given = |(key, value): (_, Option<f64>)| value.map(|value| (key, value));
        keys.into_iter().filter_map(given).collect()
    }

    /// Keys that a part of this kind needs, and those that it may have, for revolute joints.
    fn keys(&self) -> (&'static [&'static str], &'static [&'static str]) {
        match self.kind {
            Kind::Sweep => (&["speed_deg_per_s"], &["from_deg", "to_deg", "times"]),
            Kind::GrowingSine => (&["amplitude_deg", "frequency_hz", "duration_s"], &[]),
            Kind::Chirp => (&["amplitude_deg", "from_hz", "to_hz", "duration_s"], &[]),
            Kind::Multisine => (
                &["frequency_hz", "harmonics"],
                &[
                    "times",
                    "seed",
                    "tries",
                    "position_per_cent",
                    "velocity_per_cent",
                    "torque_per_cent",
                ],
            ),
            Kind::Poses => (&["hold_s"], &[]),
        }
    }

    /// Refuses numbers that are missing, of another kind, or out of range.
    fn check(&self, joints: &[(&str, JointKind)]) -> Vec<Problem> {
        let mut problems = Vec::new();
        let mut refuse = |what: String, allowed: String| problems.push(Problem::new(what, allowed));
        let title = self.title();
        let own = |name: &String| {
            let found = joints.iter().find(|(joint, _)| joint == name);
            found.map(|(_, kind)| *kind)
        };
        let kinds: Vec<JointKind> = self.joints.iter().filter_map(own).collect();
        let kind = kinds.first().copied().unwrap_or_default();
        // A multisine has no key with a unit, poses have that of each joint.
        let in_one_unit = !matches!(self.kind, Kind::Multisine | Kind::Poses);
        if in_one_unit && kinds.iter().any(|other| *other != kind) {
            refuse(
                format!("part {title:?} has revolute and prismatic joints"),
                "a part for joints in degrees, another for those in mm".to_owned(),
            );
        }
        let (needed, possible) = self.keys();
        let own = |keys: &[&'static str]| -> Vec<Cow<'static, str>> {
            keys.iter().map(|key| in_units(kind, key)).collect()
        };
        let (needed, possible) = (own(needed), own(possible));
        let given = self.given();
        for key in &needed {
            if !given.iter().any(|(own, _)| own == key) {
                refuse(format!("part {title:?} has no {key}"), key.to_string());
            }
        }
        for (key, value) in &given {
            let all = || needed.iter().chain(&possible);
            if !all().any(|own| own == key) {
                let what = if key.contains("_deg") || key.contains("_mm") {
                    format!(
                        "{key} is not of a part of this kind of {} joints",
                        kind.name()
                    )
                } else {
                    format!("{key} is not of a part of this kind")
                };
                refuse(what, listed(all().map(|key| &**key)));
                continue;
            }
            let (least, most) = range(key);
            if !(least..=most).contains(value) {
                refuse(format!("{key} = {value}"), format!("{least} to {most}"));
            }
        }
        if self.constant.is_some() && self.kind != Kind::Chirp {
            refuse(
                "constant is not of a part of this kind".to_owned(),
                "a chirp".to_owned(),
            );
        }
        let (poses, moves) = (self.kind == Kind::Poses, !self.joints.is_empty());
        if poses == moves {
            let allowed = "joints, except in a part of poses, which has poses";
            refuse(format!("part {title:?}: joints"), allowed.to_owned());
        }
        if poses == self.poses.is_empty() {
            refuse(
                format!("part {title:?}: poses"),
                "a list of poses in a part of kind poses, and in no other".to_owned(),
            );
        }
        let named = (self.joints.iter()).chain(
            self.pose
                .keys()
                .chain(self.poses.iter().flat_map(|p| p.keys())),
        );
        for joint in named {
            if !joints.iter().any(|(name, _)| name == joint) {
                let what = format!("the robot has no joint {joint:?}");
                refuse(what, listed(joints.iter().map(|(name, _)| *name)));
            }
        }
        let angles = self.pose.iter().chain(self.poses.iter().flatten());
        problems.extend(angles.filter_map(|angle| beyond(joints, angle)));
        problems
    }
}

/// A number in degrees or mm, whichever such joints have, in rad or m.
fn si(kind: JointKind, deg: Option<f64>, mm: Option<f64>) -> Option<f64> {
    let shown = match kind {
        JointKind::Revolute => deg,
        JointKind::Prismatic => mm,
    };
    shown.map(|shown| kind.si(shown))
}

/// A key of revolute joints as joints of this kind have it.
fn in_units(kind: JointKind, key: &'static str) -> Cow<'static, str> {
    match kind {
        JointKind::Revolute => Cow::Borrowed(key),
        JointKind::Prismatic => Cow::Owned(key.replace("_deg", "_mm")),
    }
}

/// A position that is none of a joint.
fn beyond(joints: &[(&str, JointKind)], (joint, angle): (&String, &f64)) -> Option<Problem> {
    let own = joints.iter().find(|(name, _)| name == joint);
    let kind = own.map_or(JointKind::Revolute, |(_, kind)| *kind);
    let (least, most) = range(&in_units(kind, "from_deg"));
    let allowed = || format!("{least} to {most}");
    let is_one = (least..=most).contains(angle);
    (!is_one).then(|| Problem::new(format!("{joint} = {angle}"), allowed()))
}

/// Least and greatest value of a key.
fn range(key: &str) -> (f64, f64) {
    match key {
        "from_deg" | "to_deg" => (-720.0, 720.0),
        "from_mm" | "to_mm" => (-10_000.0, 10_000.0),
        "speed_deg_per_s" | "speed_mm_per_s" => (0.01, 1000.0),
        "times" => (1.0, 1000.0),
        "amplitude_deg" => (1e-3, 360.0),
        "amplitude_mm" => (1e-3, 1000.0),
        "frequency_hz" | "from_hz" | "to_hz" => (1e-3, 50.0),
        "duration_s" => (0.5, 3600.0),
        "harmonics" => (1.0, 12.0),
        "tries" => (0.0, 100_000.0),
        "position_per_cent" | "velocity_per_cent" | "torque_per_cent" => (1.0, 90.0),
        "hold_s" => (0.1, 600.0),
        _ => (f64::NEG_INFINITY, f64::INFINITY),
    }
}

impl PlanFile {
    /// Reads a plan; `file`: its path, for messages.
    ///
    /// # Errors
    /// A key or value that is not allowed, with file and line.
    pub fn parse(text: &str, file: &str) -> Result<Self, Problem> {
        toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(0, |span| line_at(text, span.start));
            Problem::new(e.message(), "").at(file, line)
        })
    }

    /// Refuses whatever the robot does not have, all at once.
    ///
    /// # Errors
    /// Every problem, with file and line.
    pub fn check(&self, robot: &Robot, text: &str, file: &str) -> Result<(), Problems> {
        let joints = &robot.parameters.joints;
        let names: Vec<&str> = joints.iter().map(|joint| joint.name.as_str()).collect();
        let kinds: Vec<_> = (joints.iter())
            .map(|joint| (joint.name.as_str(), joint.kind))
            .collect();
        let mut problems = Vec::new();
        for joint in self
            .pose
            .keys()
            .filter(|joint| !names.contains(&joint.as_str()))
        {
            let what = format!("pose: the robot has no joint {joint:?}");
            problems.push(Problem::new(what, listed(names.iter().copied())).at(file, 0));
        }
        problems.extend(
            self.pose
                .iter()
                .filter_map(|angle| beyond(&kinds, angle))
                .map(|p| p.of("pose").at(file, 0)),
        );
        if self.parts.is_empty() {
            problems.push(Problem::new("the plan has no parts", "[[part]]").at(file, 0));
        }
        for part in &self.parts {
            let line = line_at(text, part.span().start);
            let wrong = part.get_ref().check(&kinds).into_iter();
            problems.extend(wrong.map(|problem| problem.at(file, line)));
        }
        if let Some(hulls) = &self.self_distance {
            let radii = hulls.radii_m.values().chain(&hulls.radius_m);
            if !radii
                .chain([&hulls.least_m])
                .all(|r| (1e-3..=2.0).contains(r))
            {
                let what = "self_distance: a radius or distance";
                problems.push(Problem::new(what, "0.001 to 2 m").at(file, 0));
            }
            let strange = hulls
                .radii_m
                .keys()
                .find(|name| !names.contains(&name.as_str()));
            if let Some(name) = strange {
                let what = format!("self_distance.radii_m: the robot has no joint {name:?}");
                problems.push(Problem::new(what, listed(names.iter().copied())).at(file, 0));
            }
        }
        if problems.is_empty() {
            Ok(())
        } else {
            Err(Problems(problems))
        }
    }
}
