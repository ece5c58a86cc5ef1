//! `[[joint]]`.

mod calibration;
mod design;
mod gains;
mod hold;
mod law;
mod limits;
mod motor_alone;
mod node;
mod signals;

use crate::Files;
use crate::drives::{Drive, Node};
use crate::general::{Feedback, name};
use crate::liveness;
use crate::parameters::{JointCalibration, JointParameters, Timing};
use crate::reader::{Allowed, Section};
use crate::sampling;
use crate::wiring::{Reach, Wiring};
pub(crate) use design::choose_designs;
pub use design::predictive_loop;
use dynamics::{Data, Model, crba, neutral};
use estimators::compliance::JointEstimatorParameters;
use estimators::encoder::EncoderParameters;
use estimators::kinematic_error::KinematicErrorParameters;
pub use hold::{hold_loop, refused_holds};
pub use motor_alone::motor_side_loop;
pub(crate) use motor_alone::{check_torque_source, choose_feedback};
use robot_state::{JointKind, MAX_JOINTS};
use signals::Signals;
use std::collections::BTreeMap;
use supervisor::DriveProfile;

/// Inputs of joints besides their own tables.
pub(crate) struct Surroundings<'a, 'd> {
    pub(crate) drives: &'a BTreeMap<&'d str, Option<Drive>>,
    pub(crate) model: Option<&'a Model>,
    pub(crate) timing: &'a Timing,
    pub(crate) feedback: &'a Feedback,
    pub(crate) files: &'a Files<'a>,
}

pub(crate) fn read(
    root: &Section<'_, '_>,
    surroundings: &Surroundings<'_, '_>,
    wiring: &mut Wiring<'_, '_>,
) -> Vec<JointParameters> {
    let Surroundings {
        drives,
        model,
        timing,
        feedback,
        files,
    } = *surroundings;
    let mut sections = root.list("joint");
    if sections.is_empty() || sections.len() > MAX_JOINTS {
        let what = format!("{} joints are not allowed", sections.len());
        root.problem("joint", what, format!("1 to {MAX_JOINTS} tables [[joint]]"));
        sections.truncate(MAX_JOINTS);
    }
    let mut named = Vec::new();
    let mut joints = Vec::new();
    for (index, mut section) in sections.into_iter().enumerate() {
        let name = name(&section, "name");
        section.which = format!(" ({name})");
        if !name.is_empty() && named.contains(&name) {
            section.problem("name", "a second joint has this name", "each joint once");
        }
        section.kind = kind(&section, &name, surroundings);
        let drive = of_section(&section, drives);
        let reader = Reader {
            section: &section,
            has_link: section.has("link_angle") || has_two_angles(&section, drive),
            index,
            timing,
            feedback,
            files,
        };
        joints.extend(reader.joint(name.clone(), drives, model, wiring));
        section.finish();
        named.push(name);
    }
    motor_alone::check_drives(root, &joints);
    if let Some(model) = model {
        let forgotten = model
            .joint_names()
            .filter(|name| !named.iter().any(|n| n == name));
        for name in forgotten {
            let what = format!("the URDF's joint {name} has no table");
            root.problem(
                "joint",
                what,
                "a table [[joint]] for each moving joint of the URDF",
            );
        }
    }
    joints
}

/// The kind of a joint: that of the URDF, or else of its drive.
fn kind(section: &Section<'_, '_>, name: &str, surroundings: &Surroundings<'_, '_>) -> JointKind {
    let in_urdf = surroundings.model.and_then(|model| {
        let joint = model.joints().get(model.joint_index(name)?)?;
        Some(if joint.kind.is_revolute() {
            JointKind::Revolute
        } else {
            JointKind::Prismatic
        })
    });
    let of_drive = of_section(section, surroundings.drives).map(|drive| drive.kind);
    in_urdf.or(of_drive).unwrap_or_default()
}

/// The drive that a joint's table names.
fn of_section<'d>(
    section: &Section<'_, '_>,
    drives: &'d BTreeMap<&str, Option<Drive>>,
) -> Option<&'d Drive> {
    let mut drives = drives.iter();
    let (_, drive) = drives.find(|(drive, _)| section.is("drive", drive))?;
    drive.as_ref()
}

/// The joint's drive is a node with two encoders.
fn has_two_angles(section: &Section<'_, '_>, drive: Option<&Drive>) -> bool {
    match drive {
        Some(drive) => drive.node.as_ref().is_some_and(Node::has_two_angles),
        // Its drive has a problem: no other follows from that.
        None => section.has("node"),
    }
}

/// Inertia at a joint with the robot stretched out and its other joints held, kg·m²; of a prismatic
/// joint mass, kg.
fn inertia(model: &Model, joint: usize) -> f64 {
    let mut data = Data::new(model);
    let first = model.base_size().0;
    crba(model, &mut data, &neutral(model))[(first + joint, first + joint)]
}

/// One table `[[joint]]`.
struct Reader<'r, 'n, 't> {
    section: &'r Section<'n, 't>,
    /// The joint has a link-side encoder.
    has_link: bool,
    index: usize,
    timing: &'r Timing,
    feedback: &'r Feedback,
    files: &'r Files<'r>,
}

impl Reader<'_, '_, '_> {
    /// Reads every key, also where an earlier one is wrong.
    fn joint(
        &self,
        name: String,
        drives: &BTreeMap<&str, Option<Drive>>,
        model: Option<&Model>,
        wiring: &mut Wiring<'_, '_>,
    ) -> Option<JointParameters> {
        let section = self.section;
        let model_index = model.and_then(|model| self.in_model(&name, model));
        let drive = self.drive(drives).filter(|drive| self.fits(drive));
        let has_link = self.has_link;
        let at_motor = drive.filter(|_| !has_link).map(Drive::at_motor);
        // Control's model of the drive: without a link-side encoder it does not see the gear.
        let seen = at_motor.as_ref().or(drive);
        let torque_limit = section.number("torque_limit_Nm", Allowed::Positive);
        let in_model = model.zip(model_index);
        let inertia = in_model.map_or(0.0, |(model, j)| inertia(model, j));
        let limits = self.limits(torque_limit, seen, (in_model, inertia));
        let gains = self.gains(seen);
        let kinematic_error = self.kinematic_error();
        let longest = sampling::MAX_PERIODS * self.timing.sample_period * 1e6;
        let skew = section.number_or("skew_us", 0.0, Allowed::Within(-longest, longest)) * 1e-6;
        let calibration = self.calibration(drive, torque_limit);
        let feed_forward = self.feed_forward(&name);
        let bus = wiring.bus(section);
        if let Some(bus) = bus.filter(|_| section.has("node")) {
            wiring.expect_nodes(bus);
        }
        // Without a drive or a bus the signals cannot be checked, but their keys are known.
        let signals = bus.zip(drive).and_then(|(bus, drive)| {
            let messages = self.add_node(&name, bus, (drive, limits.as_ref()), wiring)?;
            Some(self.signals(bus, drive, messages.as_ref(), wiring))
        });
        for key in [
            "following_error_deg",
            "following_error_A",
            "torque_velocity_limit_rad_per_s",
            "torque_mode_friction_Nm",
            "motor_angle",
            "link_angle",
            "current",
            "velocity",
            "status",
            "control",
            "temperature",
            "voltage",
            "drive_torque",
            "drive_error",
            "set_point",
            "node",
            "reply_id",
        ] {
            section.has(key);
        }

        let (drive, seen, signals) = (drive?, seen?, signals?);
        let motor_angle = signals.motor_angle?;
        let link_angle = match has_link {
            true => signals.link_angle?,
            // Its angle is as fine as the motor's, and wraps as that does.
            false => Reach {
                wrap: f64::INFINITY,
                resolution: motor_angle.resolution / drive.gear_ratio,
                ..motor_angle
            },
        };
        if !has_link {
            self.check_motor_alone(drive);
        }
        self.check_stiffness(drive);
        let limits = limits?;
        let plausibility = limits::plausibility(
            &limits,
            (drive, has_link, inertia),
            [motor_angle.resolution, link_angle.resolution],
            self.timing.sample_period,
        );
        let gap = drive.sampling.longest_gap(self.timing.sample_period);
        let encoders = EncoderParameters {
            gear_ratio: drive.gear_ratio,
            sample_period: self.timing.sample_period,
            // Travel from one cycle's sample to the next, divided by the period.
            max_velocity: drive.max_velocity * gap / self.timing.sample_period,
            max_velocity_change: plausibility.velocity_change(self.timing.sample_period),
            motor_wrap: motor_angle.wrap,
            link_wrap: link_angle.wrap,
            skew: (calibration.as_ref())
                .and_then(JointCalibration::skew)
                .unwrap_or(skew),
        };
        self.wraps(&encoders, &limits);
        Some(JointParameters {
            name,
            kind: section.kind,
            model_index: model_index?,
            bus: bus?,
            drive: section.text("drive", "")?.value.to_owned(),
            has_link_encoder: has_link,
            has_velocity: signals.has_velocity,
            has_status: signals.has_status,
            reports: signals.reports,
            thermal: drive.thermal,
            drive_profile: self.profile(drive, &signals),
            rotor_inertia: drive.rotor_inertia,
            sampling: drive.sampling,
            encoders,
            estimator: JointEstimatorParameters {
                gear_ratio: drive.gear_ratio,
                torque_limit,
                sample_period: self.timing.sample_period,
                low_pass_pole: drive.low_pass_pole,
                link_resolution: link_angle.resolution,
                motor_resolution: motor_angle.resolution,
                torsion_sigma: drive.torsion_sigma,
                current_sigma: drive.current_sigma,
                compliance: drive.compliance,
                wave_generator: drive.wave_generator,
                kinematic_error,
            },
            calibration,
            feed_forward,
            law: self.law(seen, &limits),
            drive_lag: law::LAG_OF_THE_LOOP * drive.lag,
            link_inertia: inertia,
            drive_model: seen.model,
            gains: gains?,
            torque_velocity: self.torque_velocity(&limits),
            torque_friction: section
                .optional_number("torque_mode_friction_Nm", Allowed::NonNegative),
            plausibility,
            zero_current: drive.zero_current,
            following: self.following(&limits, seen, signals.current),
            current_signal: liveness::signal(
                signals.current,
                drive.current_sigma,
                drive.flat_after,
            ),
            limits,
        })
    }

    /// The states of the joint's drive, as far as its signals allow.
    fn profile(&self, drive: &Drive, signals: &Signals) -> Option<DriveProfile> {
        let section = self.section;
        let drive_table = "[drive.NAME.state] of its drive";
        let mut profile = drive.profile.clone();
        if profile.is_some() && !signals.has_status {
            let what = format!("the key is missing, and {drive_table} determines states by it");
            section.problem("status", what, "a status signal, or a drive without states");
        }
        if signals.has_control && profile.as_ref().is_none_or(|p| p.control.is_none()) {
            let what = format!("{drive_table} has no control words to send");
            let allowed = "no such key, or profile = \"cia402\", or a table of control words";
            section.problem("control", what, allowed);
        }
        if let Some(profile) = profile.as_mut().filter(|_| !signals.has_control) {
            profile.control = None;
        }
        profile
    }

    fn in_model(&self, name: &str, model: &Model) -> Option<usize> {
        let index = model.joint_index(name);
        let names = || model.joint_names().collect::<Vec<_>>().join(", ");
        match index {
            None => {
                let body = model.bodies().iter().skip(1).find(|body| body.name == name);
                let driver = body.and_then(|body| model.joints().get(body.joint));
                let what = match driver {
                    Some(driver) => format!(
                        "the joint follows {} (<mimic> of the URDF): it has no drive of its own",
                        driver.name
                    ),
                    None => format!("the URDF has no moving joint {name}"),
                };
                self.section.problem("name", what, names());
                None
            }
            found => found,
        }
    }

    /// The drive is for joints of this kind; notes it if not.
    fn fits(&self, drive: &Drive) -> bool {
        let (kind, other) = (self.section.kind, drive.kind);
        if kind != other {
            let (kind, other) = (kind.name(), other.name());
            let what = format!("the joint is {kind}, the drive is for {other} joints");
            let allowed =
                "a drive with gear_ratio for revolute, with lead_mm_per_turn for prismatic joints";
            self.section.problem("drive", what, allowed);
        }
        kind == other
    }

    fn drive<'d>(&self, drives: &'d BTreeMap<&str, Option<Drive>>) -> Option<&'d Drive> {
        let names = drives.keys().copied().collect::<Vec<_>>().join(", ");
        let name = self.section.text("drive", &names)?.value;
        let drive = drives.get(name);
        if drive.is_none() {
            let what = format!("there is no [drive.{name}]");
            self.section.problem("drive", what, names);
        }
        drive?.as_ref()
    }

    fn kinematic_error(&self) -> KinematicErrorParameters {
        let Some(section) = self.section.optional_section("kinematic_error") else {
            return KinematicErrorParameters::default();
        };
        let kind = section.kind;
        let si = |pairs: Vec<(f64, f64)>| {
            let pairs = pairs.into_iter();
            pairs.map(|(a, b)| (kind.si(a), kind.si(b))).collect()
        };
        let link: Vec<_> = si(section.pairs("link_deg"));
        let w_link = match kind {
            JointKind::Revolute => section.number_or("w_link", 1.0, Allowed::Finite),
            // A way has no period of its own.
            JointKind::Prismatic if link.is_empty() && !section.has("w_link_per_m") => 0.0,
            JointKind::Prismatic => section.number("w_link_per_m", Allowed::Finite),
        };
        let parameters = KinematicErrorParameters {
            a0: kind.si(section.number_or("a0_deg", 0.0, Allowed::Finite)),
            w_link,
            link,
            w_motor: section.number_or("w_motor", 1.0, Allowed::Finite),
            motor: si(section.pairs("motor_deg")),
        };
        section.finish();
        parameters
    }
}
