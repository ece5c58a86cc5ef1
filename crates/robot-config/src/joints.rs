//! `[[joint]]`.

use crate::Files;
use crate::drives::Drive;
use crate::general::name;
use crate::parameters::{JointParameters, Timing};
use crate::paths;
use crate::reader::{Allowed, Section};
use crate::sampling;
use crate::slots;
use crate::units::Quantity;
use crate::wiring::{Reach, Use, Way, Wiring};
use control::{EquivalentGains, JointGains, JointLimits, MotorModel};
use dynamics::Model;
use estimators::encoder::EncoderParameters;
use estimators::joint::JointEstimatorParameters;
use estimators::kinematic_error::KinematicErrorParameters;
use identification::FitError;
use identification::joint_file::JointFile;
use robot_state::MAX_JOINTS;
use std::collections::BTreeMap;

pub(crate) fn read(
    root: &Section<'_, '_>,
    drives: &BTreeMap<&str, Option<Drive>>,
    model: Option<&Model>,
    timing: &Timing,
    files: &Files<'_>,
    wiring: &mut Wiring<'_, '_>,
) -> Vec<JointParameters> {
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
        let reader = Reader {
            section: &section,
            index,
            timing,
            files,
        };
        joints.extend(reader.joint(name.clone(), drives, model, wiring));
        section.finish();
        named.push(name);
    }
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

/// One table `[[joint]]`.
struct Reader<'r, 'n, 't> {
    section: &'r Section<'n, 't>,
    index: usize,
    timing: &'r Timing,
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
        let drive = self.drive(drives);
        let torque_limit = section.number("torque_limit_Nm", Allowed::Positive);
        let limits = self.limits(torque_limit, drive, model.zip(model_index));
        let gains = self.gains(drive);
        let kinematic_error = self.kinematic_error();
        let longest = sampling::LONGEST * self.timing.sample_period * 1e6;
        let skew = section.number_or("skew_us", 0.0, Allowed::Within(-longest, longest)) * 1e-6;
        let calibration = self.calibration(drive);
        let bus = wiring.bus(section);
        // Without a drive or a bus the signals cannot be judged; their keys are known all the same.
        let signals = bus
            .zip(drive)
            .map(|(bus, drive)| self.signals(bus, drive, wiring));
        for key in [
            "motor_angle",
            "link_angle",
            "current",
            "velocity",
            "status",
            "set_point",
        ] {
            section.has(key);
        }

        let (drive, signals) = (drive?, signals?);
        let (motor_angle, link_angle) = (signals.motor_angle?, signals.link_angle?);
        let gap = drive.sampling.longest_gap(self.timing.sample_period);
        let encoders = EncoderParameters {
            gear_ratio: drive.gear_ratio,
            sample_period: self.timing.sample_period,
            // What it may move from one cycle's sample to the next, told per period.
            max_velocity: drive.max_velocity * gap / self.timing.sample_period,
            motor_wrap: motor_angle.wrap,
            link_wrap: link_angle.wrap,
            skew: match &calibration {
                Some(file) => file
                    .encoders
                    .as_ref()
                    .map_or(skew, |encoders| encoders.skew),
                None => skew,
            },
        };
        let limits = limits?;
        self.wraps(&encoders, &limits);
        Some(JointParameters {
            name,
            model_index: model_index?,
            bus: bus?,
            drive: section.text("drive", "")?.value.to_owned(),
            has_velocity: signals.has_velocity,
            has_status: signals.has_status,
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
            motor: drive.motor,
            gains: gains?,
            limits,
        })
    }

    /// The joint file that `calibration` names, which must be of such a drive at such a rate.
    fn calibration(&self, drive: Option<&Drive>) -> Option<JointFile> {
        const ALLOWED: &str = "the path of a joint file that `torquectl fit` wrote";
        let section = self.section;
        let named = section.optional_text("calibration", ALLOWED)?;
        let path = paths::resolved(self.files.config, named.value);
        let problem = |what: String| section.problem("calibration", what, ALLOWED);
        let file = match (self.files.read)(&path) {
            Ok(text) => JointFile::parse(&text, &path, self.files.read),
            Err(error) => Err(FitError(format!("{path}: {error}"))),
        };
        // What cannot be built is said here, not by the loop.
        let file = file.and_then(|file| file.estimators().map(|_| file));
        let file = match file {
            Ok(file) => file,
            Err(error) => {
                problem(error.to_string());
                return None;
            }
        };
        let rate = 1.0 / self.timing.sample_period;
        let ratio = drive.map_or(file.joint.gear_ratio, |drive| drive.gear_ratio);
        for (what, theirs, ours) in [
            ("sample_rate_hz", file.joint.sample_rate, rate),
            ("gear_ratio", file.joint.gear_ratio, ratio),
        ] {
            if (theirs - ours).abs() > 1e-6 * ours.abs() {
                problem(format!(
                    "{path} is for {what} = {theirs}, this joint has {ours}"
                ));
                return None;
            }
        }
        Some(file)
    }

    fn in_model(&self, name: &str, model: &Model) -> Option<usize> {
        let index = model.joint_index(name);
        let names = || model.joint_names().collect::<Vec<_>>().join(", ");
        match index {
            None => {
                let what = format!("the URDF has no moving joint {name}");
                self.section.problem("name", what, names());
                None
            }
            Some(joint) if !model.joints().get(joint)?.kind.is_revolute() => {
                let what = format!("the URDF's joint {name} does not turn");
                self.section
                    .problem("name", what, "revolute and continuous joints");
                None
            }
            found => found,
        }
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

    fn limits(
        &self,
        torque_limit: f64,
        drive: Option<&Drive>,
        joint: Option<(&Model, usize)>,
    ) -> Option<JointLimits> {
        let section = self.section;
        let delta_q = section.number("delta_q_limit_deg", Allowed::Within(0.0, 90.0));
        let (min_deg, max_deg) = ("position_min_deg", "position_max_deg");
        // Without a model the limits cannot be judged; the keys are known all the same.
        let given = [min_deg, max_deg].map(|key| section.optional_number(key, Allowed::Finite));
        let (model, index) = joint?;
        let urdf = model.joint_limits(index)?;
        let min = given[0].map_or(urdf.lower, f64::to_radians);
        let max = given[1].map_or(urdf.upper, f64::to_radians);
        // A rounded degree may lie a hair outside.
        let hair = 1e-6;
        let allowed = format!(
            "{:.3} to {:.3}, the URDF's limits",
            urdf.lower.to_degrees(),
            urdf.upper.to_degrees()
        );
        for (key, value) in [(min_deg, min), (max_deg, max)] {
            if value < urdf.lower - hair || value > urdf.upper + hair {
                let what = format!("{:.3} is not allowed", value.to_degrees());
                section.problem(key, what, &allowed);
            }
        }
        if min >= max {
            let what = format!("{:.3} is not above {min_deg}", max.to_degrees());
            section.problem(max_deg, what, allowed);
        }
        Some(JointLimits {
            position_min: min,
            position_max: max,
            torque: torque_limit.min(urdf.effort),
            delta_q: delta_q.to_radians(),
            current: drive?.current_limit,
        })
    }

    /// Either `K_s` and `K_d`, or for position-commanded drives `K6` and `K7` (D13-14).
    fn gains(&self, drive: Option<&Drive>) -> Option<JointGains> {
        let section = self.section.section("gains")?;
        let k_p = section.number("K_p", Allowed::NonNegative);
        let k_i = section.number_or("K_i_per_s", 0.0, Allowed::NonNegative);
        let equivalent = section.has("K6") || section.has("K7_s");
        let gains = if equivalent {
            let gains = EquivalentGains {
                k6: section.number("K6", Allowed::NonNegative),
                k7: section.number("K7_s", Allowed::NonNegative),
            };
            match drive.map(|drive| drive.motor) {
                Some(MotorModel::Position { k_tau, .. }) => {
                    Some(JointGains::from_equivalent(gains, k_tau, k_p, k_i))
                }
                Some(MotorModel::Current { .. }) => {
                    let what = "the drive takes currents, not positions";
                    section.problem("K6", what, "K_s_Nm_per_rad and K_d_Nms_per_rad");
                    None
                }
                None => None,
            }
        } else {
            Some(JointGains {
                k_p,
                k_i,
                k_s: section.number("K_s_Nm_per_rad", Allowed::NonNegative),
                k_d: section.number("K_d_Nms_per_rad", Allowed::NonNegative),
            })
        };
        section.finish();
        gains
    }

    fn kinematic_error(&self) -> KinematicErrorParameters {
        let Some(section) = self.section.optional_section("kinematic_error") else {
            return KinematicErrorParameters::default();
        };
        let radians = |pairs: Vec<(f64, f64)>| {
            let pairs = pairs.into_iter();
            pairs
                .map(|(a, b)| (a.to_radians(), b.to_radians()))
                .collect()
        };
        let parameters = KinematicErrorParameters {
            a0: section
                .number_or("a0_deg", 0.0, Allowed::Finite)
                .to_radians(),
            w_link: section.number_or("w_link", 1.0, Allowed::Finite),
            link: radians(section.pairs("link_deg")),
            w_motor: section.number_or("w_motor", 1.0, Allowed::Finite),
            motor: radians(section.pairs("motor_deg")),
        };
        section.finish();
        parameters
    }

    fn signals(&self, bus: usize, drive: &Drive, wiring: &mut Wiring<'_, '_>) -> Signals {
        let joint = self.index;
        let motor_counts = Quantity::Angle {
            counts_per_turn: drive.motor_counts_per_turn,
            key: "motor_counts_per_turn",
        };
        let link_counts = Quantity::Angle {
            counts_per_turn: drive.link_counts_per_turn,
            key: "link_counts_per_turn",
        };
        let set_point = match drive.motor {
            MotorModel::Position { .. } => link_counts,
            MotorModel::Current { .. } => Quantity::Current,
        };
        let mut signal = |key, way, slot, quantity| {
            let section = self.section.section(key)?;
            let sign = match quantity {
                Quantity::Status => 1.0,
                _ => section.sign_or("direction", 1.0),
            };
            let offset = match quantity {
                Quantity::Angle { .. } => section.number_or("offset_deg", 0.0, Allowed::Finite),
                _ => 0.0,
            };
            let how = Use {
                way,
                bus,
                slot,
                quantity,
                sign,
                offset: offset.to_radians(),
            };
            let path = section.text("signal", "MESSAGE.signal");
            let reach = path.and_then(|path| wiring.connect(&section.path("signal"), &path, &how));
            section.finish();
            reach
        };
        let _noted = signal(
            "current",
            Way::Receive,
            slots::current(joint),
            Quantity::Current,
        );
        let _noted = signal("set_point", Way::Send, slots::command(joint), set_point);
        let [has_velocity, has_status] = ["velocity", "status"].map(|key| self.section.has(key));
        if has_velocity {
            signal(
                "velocity",
                Way::Receive,
                slots::velocity(joint),
                Quantity::Velocity,
            );
        }
        if has_status {
            signal(
                "status",
                Way::Receive,
                slots::status(joint),
                Quantity::Status,
            );
        }
        Signals {
            motor_angle: signal(
                "motor_angle",
                Way::Receive,
                slots::motor_angle(joint),
                motor_counts,
            ),
            link_angle: signal(
                "link_angle",
                Way::Receive,
                slots::link_angle(joint),
                link_counts,
            ),
            has_velocity,
            has_status,
        }
    }

    /// Encoders whose turns cannot be told apart.
    fn wraps(&self, encoders: &EncoderParameters, limits: &JointLimits) {
        let travel = encoders.max_velocity * encoders.sample_period;
        let sides = [
            (
                "motor_angle",
                encoders.motor_wrap,
                travel * encoders.gear_ratio,
            ),
            ("link_angle", encoders.link_wrap, travel),
        ];
        for (key, wrap, travel) in sides {
            if wrap <= 2.0 * travel {
                let what = format!(
                    "the signal starts again after {wrap:.4} rad, and the joint can move {travel:.4} rad in a cycle"
                );
                let allowed = "a range of more than twice that, see drive.max_velocity_rad_per_s";
                self.section.problem(key, what, allowed);
            }
        }
        let range = (limits.position_min, limits.position_max);
        let half = 0.5 * encoders.link_wrap;
        if range.0.is_finite() && range.1.is_finite() && (range.0 < -half || range.1 > half) {
            let what = format!(
                "the signal starts again after {:.3} deg, and the joint moves from {:.3} to {:.3} deg",
                encoders.link_wrap.to_degrees(),
                range.0.to_degrees(),
                range.1.to_degrees()
            );
            let allowed = "position limits within half the signal's range on either side of zero";
            self.section.problem("link_angle", what, allowed);
        }
    }
}

/// What came of a joint's signals.
struct Signals {
    motor_angle: Option<Reach>,
    link_angle: Option<Reach>,
    has_velocity: bool,
    has_status: bool,
}
