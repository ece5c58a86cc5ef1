//! Configuration of a drawn joint, as a user would write it: every size wrong by up to 15 %, K_s as `torquectl check`
//! allows it.

use crate::draw::Drawn;
use crate::plant::{DT, Waves};
use robot_config::Robot;
use robot_config::torque_loops::{refused_loops, torque_loops};
use std::io;
use test_support::Random;

/// By how much a size may be wrong.
pub(crate) const ERROR: f64 = 0.15;
/// K_s of the shipped robots over 1/K_tau, and K_d over K_s, s.
const STIFFNESS: f64 = 0.5;
const DAMPING_S: f64 = 0.01;
/// Share of the largest K_s that `check` names which the user then takes, and how often it is asked.
const BELOW: f64 = 0.98;
const TRIES: usize = 4;
/// Gravity, m/s².
const G: f64 = 9.81;

/// Sizes as they are known.
struct Known {
    gear: f64,
    drive: f64,
    damping: f64,
    dead_zone: f64,
    rotor: f64,
    torque_constant: f64,
    coulomb: f64,
    viscous: f64,
    presliding: Option<f64>,
    delay: f64,
    lag: f64,
    link: f64,
    weight: f64,
    kinematic: [Waves; 2],
}

/// Configuration of the bristles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bristles {
    /// `presliding_rad`, wrong as all other sizes.
    Known,
    /// Nothing, as in the shipped robots.
    NotGiven,
}

impl Known {
    fn new(drawn: &Drawn, bristles: Bristles) -> Self {
        let mut random = Random::new(drawn.seed ^ 0x0C0F_FEE0);
        let mut known = |size: f64| size * (1.0 + ERROR * random.symmetric());
        let (c, m, d) = (&drawn.catalogue, &drawn.mechanism, &drawn.drive);
        let n = m.ratio;
        // A data sheet names the torsion at the rated torque.
        let gear = c.torsion(c.rated) / drawn.gear.torsion_of(c.rated);
        let friction = &drawn.friction.sizes;
        let transport = drawn.transport;
        let presliding = known(drawn.presliding);
        let mut waves = |waves: &Waves| {
            let one = |&(amplitude, periods, phase)| (known(amplitude), periods, phase);
            waves.iter().map(one).collect()
        };
        let [of_link, of_motor] = &m.kinematic;
        let kinematic = [waves(of_link), waves(of_motor)];
        Self {
            gear: known(gear),
            drive: known(d.stiffness),
            damping: known(d.damping),
            dead_zone: known(d.dead_zone),
            rotor: known(m.rotor / (n * n)),
            torque_constant: known(drawn.torque_constant),
            coulomb: known(friction.coulomb / n),
            viscous: known(friction.viscous / (n * n)),
            presliding: (bristles == Bristles::Known).then_some(presliding),
            delay: known(transport.delay + 0.5 * transport.jitter),
            lag: known(d.mean_lag(DT)),
            link: known(m.link),
            weight: known(m.weight),
            kinematic,
        }
    }
}

/// The configuration of a joint that `torquectl check` lets run; none: its loop has too little margin with any K_s.
///
/// # Errors
/// A configuration that cannot be loaded.
pub(crate) fn robot(drawn: &Drawn, bristles: Bristles) -> Result<Option<Robot>, String> {
    let known = Known::new(drawn, bristles);
    let k_tau = 1.0 / (known.gear * drawn.catalogue.k_fs0) + 1.0 / known.drive;
    let mut k_s = STIFFNESS / k_tau;
    for _ in 0..TRIES {
        let read = |path: &str| -> io::Result<String> {
            match path.rsplit('/').next() {
                Some("robot.toml") => Ok(toml(drawn, &known, k_tau, k_s)),
                Some("robot.urdf") => Ok(urdf(drawn, &known)),
                Some("drives.dbc") => Ok(dbc(drawn.bits)),
                _ => Err(io::ErrorKind::NotFound.into()),
            }
        };
        let robot = robot_config::load("robot.toml", &read);
        let robot = robot.map_err(|e| format!("{}: {e}", drawn.name))?;
        if refused_loops(&robot, "robot.toml").is_empty() {
            return Ok(Some(robot));
        }
        let most = torque_loops(&robot)
            .first()
            .map_or(0.0, |l| l.largest_stiffness());
        let next = BELOW * most.min(k_s);
        if next <= 0.0 {
            return Ok(None);
        }
        k_s = next;
    }
    Ok(None)
}

/// Pairs of cosine and sine, degrees, by the harmonics from the first on.
fn harmonics(waves: &Waves, first: f64) -> String {
    let most = waves.iter().fold(0.0, |most: f64, wave| most.max(wave.1));
    let count = (most / first).round() as usize;
    let mut pairs = vec![[0.0; 2]; count];
    for (amplitude, periods, phase) in waves {
        let place = (periods / first).round() as usize - 1;
        pairs[place] = [amplitude * phase.sin(), amplitude * phase.cos()].map(f64::to_degrees);
    }
    format!("{pairs:?}")
}

fn toml(drawn: &Drawn, known: &Known, k_tau: f64, k_s: f64) -> String {
    let c = &drawn.catalogue;
    let presliding =
        (known.presliding).map_or(String::new(), |p| format!("presliding_rad = {p:?}"));
    let numbers = [
        ("RATIO", c.ratio),
        ("TORQUE_CONSTANT", known.torque_constant),
        ("ROTOR", known.rotor),
        ("MAX_VELOCITY", c.max_velocity),
        ("LINK_COUNTS", f64::from(1_u32 << drawn.bits)),
        ("K_FS0", known.gear * c.k_fs0),
        ("C_FS", c.c_fs),
        ("K_WG0", known.gear * c.k_wg0),
        ("C_WG", c.c_wg),
        ("COULOMB", known.coulomb),
        ("VISCOUS", known.viscous),
        ("K_TAU", k_tau),
        ("K_V", known.damping / known.drive),
        ("DEAD_ZONE", known.dead_zone),
        ("DELAY", 1e6 * known.delay),
        ("LAG", 1e6 * known.lag),
        ("LIMIT", c.limit),
        ("K_S", k_s),
        ("K_D", DAMPING_S * k_s),
    ];
    let filled = numbers.iter().fold(TOML.to_owned(), |text, (key, number)| {
        text.replace(&format!("<{key}>"), &format!("{number:?}"))
    });
    let [of_link, of_motor] = &known.kinematic;
    (filled.replace("<PRESLIDING>", &presliding))
        .replace("<LINK_WAVES>", &harmonics(of_link, 1.0))
        .replace("<MOTOR_WAVES>", &harmonics(of_motor, 1.0))
}

/// A link whose weight pulls at most so far from the axis that its inertia is that of the joint.
fn urdf(drawn: &Drawn, known: &Known) -> String {
    let moment = (known.weight / G).max(1e-3);
    let arm = (0.8 * known.link / moment).min(0.25);
    let mass = moment / arm;
    let inertia = known.link - mass * arm * arm;
    let (limit, velocity) = (drawn.catalogue.limit, drawn.catalogue.max_velocity);
    URDF.replace("<ARM>", &format!("{arm:?}"))
        .replace("<MASS>", &format!("{mass:?}"))
        .replace("<INERTIA>", &format!("{inertia:?}"))
        .replace("<LIMIT>", &format!("{limit:?}"))
        .replace("<VELOCITY>", &format!("{velocity:?}"))
}

fn dbc(bits: u32) -> String {
    DBC.replace("<BITS>", &bits.to_string())
        .replace("<MOST>", &((1_u32 << bits) - 1).to_string())
}

const TOML: &str = include_str!("robot.toml");
const URDF: &str = include_str!("robot.urdf");
const DBC: &str = include_str!("drives.dbc");
