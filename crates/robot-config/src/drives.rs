//! `[drive.NAME]`: kinds of drive.

mod actuator;
mod canopen;
mod state;
mod thermal;

use crate::Files;
use crate::liveness;
use crate::parameters::Thermal;
use crate::reader::{Allowed, Section};
use crate::sampling::{self, Sampling};
pub(crate) use actuator::ActuatorKind;
pub(crate) use canopen::CanopenDrive;
use control::{CurrentDrive, DriveModel, PositionDrive};
use core::f64::consts::TAU;
use drives_of_makers::family::{FAMILIES, translation};
use estimators::compliance::ComplianceParameters;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use robot_state::JointKind;
use std::collections::BTreeMap;
use supervisor::DriveProfile;

/// A kind of drive.
#[derive(Clone)]
pub(crate) struct Drive {
    /// Kind of the joints that it moves.
    pub(crate) kind: JointKind,
    /// N: motor's angle for a way of the joint, 1 or rad/m.
    pub(crate) gear_ratio: f64,
    pub(crate) rotor_inertia: f64,
    pub(crate) max_velocity: f64,
    pub(crate) motor_counts_per_turn: Option<f64>,
    /// Counts of the link-side encoder, of a revolute joint for a turn, of a prismatic one for a mm.
    pub(crate) link_counts: Option<f64>,
    /// A drive whose set-points are withdrawn is sent no current until it is off.
    pub(crate) zero_current: bool,
    pub(crate) low_pass_pole: f64,
    pub(crate) torsion_sigma: f64,
    pub(crate) current_sigma: f64,
    /// Equal samples of the current after which it is flat; none: by its noise.
    pub(crate) flat_after: Option<u32>,
    pub(crate) sampling: Sampling,
    pub(crate) compliance: ComplianceParameters,
    pub(crate) wave_generator: WaveGeneratorParameters,
    /// Way of the motor over which its friction builds up, rad; none: not known.
    pub(crate) presliding: Option<f64>,
    pub(crate) model: DriveModel,
    /// Time in which the drive answers a command, s.
    pub(crate) lag: f64,
    /// None: the drive has no states.
    pub(crate) profile: Option<DriveProfile>,
    /// Torque at the output for each ampere, N·m/A.
    pub(crate) torque_per_current: f64,
    /// How hot it may get; none: it is not watched.
    pub(crate) thermal: Option<Thermal>,
    /// Who makes its frames; none: DBC files describe them.
    pub(crate) node: Option<Node>,
}

/// A drive whose frames no DBC file describes.
#[derive(Clone)]
pub(crate) enum Node {
    /// By CiA 402.
    Canopen(CanopenDrive),
    /// By its maker's own frames.
    Actuator(ActuatorKind),
}

impl Node {
    /// It has an encoder on either side of its gear.
    pub(crate) fn has_two_angles(&self) -> bool {
        matches!(self, Self::Canopen(drive) if drive.kind.other_angle.is_some())
    }
}

impl Drive {
    /// The drive of a joint whose only angle is the motor's: its K_tau contains no gear.
    pub(crate) fn at_motor(&self) -> Self {
        let mut drive = self.clone();
        if let DriveModel::Position(model) = &mut drive.model {
            model.k_tau_motor = model.k_tau;
        }
        drive
    }
}

/// Integral times of velocity loops, ms. A quicker one is of the order of the bus's delay, where the law's model of it,
/// which is constant within a period, ends; a slower one is a drift of seconds, which the disturbance observer takes up.
const INTEGRAL_TIMES_MS: [f64; 2] = [5.0, 10_000.0];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Command {
    Position,
    Current,
}

/// The drives by name; nothing stands for one with a problem.
pub(crate) fn read<'n>(
    root: &Section<'n, '_>,
    sample_period: f64,
    files: &Files<'_>,
) -> BTreeMap<&'n str, Option<Drive>> {
    let Some(section) = root.section("drive") else {
        return BTreeMap::new();
    };
    let drives = section.named_sections();
    drives
        .into_iter()
        .map(|(name, section)| (name, drive(section, sample_period, files)))
        .collect()
}

fn drive(section: Section<'_, '_>, sample_period: f64, files: &Files<'_>) -> Option<Drive> {
    let (kind, gear_ratio) = gear(&section);
    let section = section.of_kind(kind);
    let torque_constant = section.number("torque_constant_Nm_per_A", Allowed::Positive);
    let rotor_inertia = section.number("rotor_inertia_kg_m2", Allowed::Positive);
    let max_velocity = section.number("max_velocity_rad_per_s", Allowed::Positive);
    let counts = Allowed::Within(2.0, 4_294_967_296.0);
    let motor_counts_per_turn = section.optional_number("motor_counts_per_turn", counts);
    let link_counts = section.optional_number(link_counts_key(kind), counts);
    let current_sigma = section.number_or("current_sigma_A", 0.0, Allowed::NonNegative);
    let sampling = sampling::read(&section, sample_period);
    let flat_after = liveness::flat_after(&section, &sampling, sample_period);
    let command = section.choice(
        "command",
        &[
            ("position", Command::Position),
            ("current", Command::Current),
        ],
    );
    let (current_limit, zero_current) = match command {
        Command::Position => (f64::INFINITY, false),
        Command::Current => (
            section.number("current_limit_A", Allowed::Positive),
            section.choice_or(
                "withdrawn",
                true,
                &[("zero_current", true), ("none", false)],
            ),
        ),
    };
    let node = node(&section, command, (gear_ratio, torque_constant), files);
    let profile = section
        .optional_section("state")
        .map(|section| state::read(section, sample_period))
        .or_else(|| match node.as_ref()?.as_ref()? {
            Node::Canopen(_) => Some(state::cia402(sample_period)),
            Node::Actuator(kind) => {
                let made = translation::named(kind.family);
                let bears = made.is_some_and(|family| family.commands_gains());
                Some(state::actuator(sample_period, bears))
            }
        });
    let lag = 1e-6 * section.number_or("command_lag_us", 400.0, Allowed::Within(0.0, 5000.0));
    let compliance = section.section("compliance").map(compliance);
    let friction = section
        .section("friction")
        .map(|section| friction(section, torque_constant));
    let motor = section.section("motor");
    let thermal = section.optional_section("thermal").map(thermal::read);
    section.finish();
    let (compliance, low_pass_pole, torsion_sigma) = compliance?;
    let (wave_generator, presliding) = friction?;
    let model = match command {
        Command::Position => DriveModel::Position(takes_position(motor?, 1.0 / compliance.k_fs0)),
        Command::Current => DriveModel::Current(takes_current(motor?, current_limit)),
    };
    Some(Drive {
        kind,
        gear_ratio,
        rotor_inertia,
        max_velocity,
        motor_counts_per_turn,
        link_counts,
        zero_current,
        low_pass_pole,
        torsion_sigma,
        current_sigma,
        flat_after,
        sampling,
        compliance,
        wave_generator,
        presliding,
        model,
        lag,
        profile,
        torque_per_current: gear_ratio * torque_constant,
        thermal,
        node: node?,
    })
}

/// What `profile` and its table say; nothing if there is a problem with them.
fn node(
    section: &Section<'_, '_>,
    command: Command,
    (gear_ratio, torque_constant): (f64, f64),
    files: &Files<'_>,
) -> Option<Option<Node>> {
    let families = FAMILIES.map(|family| (family.name(), Profile::Family(family.name())));
    let mut profiles = vec![("dbc", Profile::Dbc), ("cia402", Profile::Cia402)];
    profiles.extend(families);
    match section.choice_or("profile", Profile::Dbc, &profiles) {
        Profile::Dbc => Some(None),
        Profile::Cia402 => {
            let section = section.section("canopen")?;
            let drive = canopen::read(section, command, (gear_ratio, torque_constant), files)?;
            Some(Some(Node::Canopen(drive)))
        }
        Profile::Family(family) => {
            if command == Command::Current {
                let what = "\"current\" is not allowed: the joint has no link-side encoder";
                section.problem("command", what, "\"position\"");
            }
            let kind = actuator::read(section.section("actuator")?, family, gear_ratio)?;
            Some(Some(Node::Actuator(kind)))
        }
    }
}

/// `profile`.
#[derive(Clone, Copy, PartialEq)]
enum Profile {
    Dbc,
    Cia402,
    Family(&'static str),
}

/// The kind of the drive's joints and N: the gear ratio, or of a prismatic joint `2 pi` over the lead.
fn gear(section: &Section<'_, '_>) -> (JointKind, f64) {
    let Some(lead) = section.optional_number("lead_mm_per_turn", Allowed::Within(1e-3, 1e4)) else {
        let ratio = section.number("gear_ratio", Allowed::Within(1.0, 10_000.0));
        return (JointKind::Revolute, ratio);
    };
    if section.has("gear_ratio") {
        let what =
            "the lead contains the gear already: it is the joint's way for a turn of the motor";
        section.problem(
            "gear_ratio",
            what,
            "lead_mm_per_turn or gear_ratio, not both",
        );
    }
    (JointKind::Prismatic, TAU / (1e-3 * lead))
}

/// The key of the link-side encoder's resolution.
pub(crate) fn link_counts_key(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "link_counts_per_turn",
        JointKind::Prismatic => "link_counts_per_mm",
    }
}

/// The model, the low-pass's pole, and the standard deviation of the unmodelled torsion.
fn compliance(section: Section<'_, '_>) -> (ComplianceParameters, f64, f64) {
    let parameters = ComplianceParameters {
        k_fs0: section.number("K_fs0_Nm_per_rad", Allowed::Positive),
        c_fs: section.number("C_fs_per_Nm", Allowed::NonNegative),
        k_wg0: section.number("K_wg0_Nm_per_rad", Allowed::Positive),
        c_wg: section.number("C_wg_per_Nm", Allowed::NonNegative),
    };
    let pole = section.number_or("low_pass_pole", 0.95, Allowed::Below(0.0, 1.0));
    let sigma = section.number_or("torsion_sigma_deg", 0.0, Allowed::NonNegative);
    let sigma = section.kind.si(sigma);
    section.finish();
    (parameters, pole, sigma)
}

/// Friction of the motor, and the way over which it builds up.
fn friction(
    section: Section<'_, '_>,
    torque_constant: f64,
) -> (WaveGeneratorParameters, Option<f64>) {
    // It is the motor's.
    let section = section.of_kind(JointKind::Revolute);
    let rules = [
        ("physical", FrictionRule::Physical),
        ("published", FrictionRule::Published),
    ];
    let parameters = WaveGeneratorParameters {
        torque_constant,
        friction: section.number("coulomb_Nm", Allowed::NonNegative),
        viscous_friction: section.number("viscous_Nms_per_rad", Allowed::NonNegative),
        epsilon: section.number("epsilon_rad_per_s", Allowed::Positive),
        rule: section.choice_or("rule", FrictionRule::Physical, &rules),
    };
    let presliding = section.optional_number("presliding_rad", Allowed::Within(1e-4, 1.0));
    section.finish();
    (parameters, presliding)
}

/// Least angle by torque that is left to the drive's own loop, rad/(N·m) or m/N: so stiff that a joint's gear is all.
const LEAST_K_TAU: f64 = 1e-9;

/// The model of a drive that takes positions; `gear_softness`: the gear's part of K_tau, rad/(N·m) or m/N.
fn takes_position(section: Section<'_, '_>, gear_softness: f64) -> PositionDrive {
    let k_tau = section.number("K_tau_rad_per_Nm", Allowed::Positive);
    let widest = section.kind.threshold(0.1);
    let times = Allowed::Within(INTEGRAL_TIMES_MS[0], INTEGRAL_TIMES_MS[1]);
    let time = section.optional_number("integral_time_ms", times);
    let drive = PositionDrive {
        k_tau,
        k_tau_motor: (k_tau - gear_softness).max(LEAST_K_TAU),
        k_v: section.number("K_v_s", Allowed::NonNegative),
        k_c: section.number("K_c_rad", Allowed::NonNegative),
        sign_smoothing: section.number("sign_smoothing_rad_per_s", Allowed::Positive),
        dead_zone: section.number_or("dead_zone_rad", 0.0, Allowed::Below(0.0, widest)),
        integral: time.map_or(0.0, |time| 1e3 / time),
    };
    section.finish();
    drive
}

/// The model of a drive that takes currents up to `current_limit`, A.
fn takes_current(section: Section<'_, '_>, current_limit: f64) -> CurrentDrive {
    let drive = CurrentDrive {
        k_1: section.number("K_1_Nm_per_A", Allowed::Positive),
        k_2: section.number("K_2_Nms_per_rad", Allowed::NonNegative),
        k_3: section.number("K_3_Nm", Allowed::NonNegative),
        sign_smoothing: section.number("sign_smoothing_rad_per_s", Allowed::Positive),
        current_limit,
    };
    section.finish();
    drive
}
