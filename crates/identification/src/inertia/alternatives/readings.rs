//! The readings of a log's columns that are tried, and their words.

use super::super::robot::Robot;
use super::super::rows::Rows;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Rows by which torques are shifted at most.
pub(super) const SHIFTS: i64 = 12;
/// Rows by which columns of one joint are shifted.
const JOINT_SHIFTS: [i64; 8] = [-5, -3, -2, -1, 1, 2, 3, 5];
/// Zeros that are off, beside quarters and halves of a turn, rad.
const ZEROS: [f64; 6] = [-0.52, -0.35, -0.17, 0.17, 0.35, 0.52];
/// Bounds of soft saturation, as multiples of the largest torque.
const BOUNDS: [f64; 4] = [1.01, 1.04, 1.1, 1.3];

/// Times over those of the stamps that are tried.
const STAMPS: [f64; 10] = [0.25, 0.4, 0.5, 0.63, 0.8, 1.25, 1.6, 2.0, 2.5, 4.0];

/// Another meaning of a log's torques and angles.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Reading {
    Angle(usize, f64, f64),
    Torque(usize, f64),
    Both(usize),
    Exchanged(Columns, usize, usize),
    Order(Columns, Vec<usize>, &'static str),
    AllTorques(f64),
    Gravity(Vector3<f64>),
    /// Time over that of the stamps.
    Stamps(f64),
    Late(i64),
    /// Angles or torques of one joint, by rows.
    LateJoint(Columns, usize, i64),
    /// A torque that saturates softly, at a multiple of its largest.
    Saturated(usize, f64),
}

/// Columns that may be exchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Columns {
    Angles,
    Torques,
    All,
}

/// Every reading that is tried.
pub(super) fn readings(robot: &Robot<'_>) -> Vec<Reading> {
    let n = robot.measured.len();
    let kind = |k: usize| robot.model.joints()[robot.measured[k]].kind.is_revolute();
    let mut all = Vec::new();
    for k in 0..n {
        all.push(Reading::Angle(k, -1.0, 0.0));
        if kind(k) {
            for turn in [FRAC_PI_2, -FRAC_PI_2, PI] {
                all.push(Reading::Angle(k, 1.0, turn));
                all.push(Reading::Angle(k, -1.0, turn));
            }
            all.extend(ZEROS.map(|zero| Reading::Angle(k, 1.0, zero)));
        }
        for columns in [Columns::Angles, Columns::Torques] {
            all.extend(JOINT_SHIFTS.map(|rows| Reading::LateJoint(columns, k, rows)));
        }
        all.extend(BOUNDS.map(|multiple| Reading::Saturated(k, multiple)));
        all.extend([-1.0, 1e-3, 1e3].map(|factor| Reading::Torque(k, factor)));
        all.push(Reading::Both(k));
    }
    for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))) {
        let both = [Columns::All, Columns::Angles, Columns::Torques];
        all.extend(both.map(|columns| Reading::Exchanged(columns, a, b)));
    }
    let mut named: Vec<usize> = (0..n).collect();
    named.sort_by_key(|&k| robot.name(k));
    // Column c of the log is of joint named[c]: joint k takes the column at which it stands.
    let place = |k: usize| named.iter().position(|j| *j == k).unwrap_or(k);
    let alphabetical: Vec<usize> = (0..n).map(place).collect();
    let backwards: Vec<usize> = (0..n).rev().collect();
    for columns in [Columns::All, Columns::Angles, Columns::Torques] {
        if n > 2 {
            all.push(Reading::Order(
                columns,
                alphabetical.clone(),
                "in alphabetical order",
            ));
            all.push(Reading::Order(
                columns,
                backwards.clone(),
                "from the tip to the root",
            ));
        }
    }
    all.extend([-1.0, 1e-3, 1e3].map(Reading::AllTorques));
    all.extend(STAMPS.map(Reading::Stamps));
    let size = robot.model.gravity().norm();
    if size > 0.0 {
        all.push(Reading::Gravity(Vector3::zeros()));
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            for sign in [-size, size] {
                let gravity = axis * sign;
                if (gravity - robot.model.gravity()).norm() > 0.1 * size {
                    all.push(Reading::Gravity(gravity));
                }
            }
        }
    }
    all.extend((-SHIFTS..=SHIFTS).filter(|k| *k != 0).map(Reading::Late));
    all
}

impl Columns {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Angles => "q",
            Self::Torques => "tau",
            Self::All => "q and tau",
        }
    }
}

impl Reading {
    /// The reading in words that follow "if".
    pub(super) fn words(&self, robot: &Robot<'_>, rows: &Rows) -> String {
        match self {
            Self::Angle(k, sign, offset) => {
                let name = robot.name(*k);
                let way = if *sign < 0.0 {
                    " counts the other way"
                } else {
                    ""
                };
                let turn = if *offset == 0.0 {
                    String::new()
                } else {
                    let and = if way.is_empty() { "" } else { " and" };
                    format!("{and} has its zero {:.0} degrees off", offset.to_degrees())
                };
                format!("q of `{name}`{way}{turn}")
            }
            Self::Torque(k, factor) => {
                format!("tau of `{}` {}", robot.name(*k), scaled(*factor))
            }
            Self::Both(k) => format!("q and tau of `{}` count the other way", robot.name(*k)),
            Self::Exchanged(columns, a, b) => format!(
                "columns {} of `{}` and `{}` are exchanged",
                columns.words(),
                robot.name(*a),
                robot.name(*b)
            ),
            Self::Order(columns, _, order) => format!("columns {} come {order}", columns.words()),
            Self::AllTorques(factor) => format!("tau of all joints {}", scaled(*factor)),
            Self::Gravity(g) if g.norm() == 0.0 => {
                "tau holds no gravity (a controller has taken it off)".to_owned()
            }
            Self::Saturated(k, _) => format!("tau of `{}` saturates softly", robot.name(*k)),
            Self::LateJoint(columns, k, shift) => {
                let way = if *shift > 0 { "late" } else { "early" };
                let ms = 1e3 * step(rows) * shift.abs() as f64;
                format!(
                    "{} of `{}` is {way} by some {ms:.0} ms",
                    columns.words(),
                    robot.name(*k)
                )
            }
            Self::Gravity(g) => format!(
                "gravity in the root link's axes is {:.2},{:.2},{:.2} (--gravity)",
                g.x, g.y, g.z
            ),
            Self::Stamps(factor) => {
                format!("stamps count time otherwise: {factor} s pass in a second of theirs")
            }
            Self::Late(shift) => {
                let step = step(rows);
                let (late, early) = if *shift > 0 {
                    ("tau", "q")
                } else {
                    ("q", "tau")
                };
                format!(
                    "{late} is late against {early} by some {:.0} ms",
                    1e3 * step * shift.abs() as f64
                )
            }
        }
    }
}

/// Time between rows, s.
fn step(rows: &Rows) -> f64 {
    let steps = rows.stamps.windows(2).map(|w| w[1].1 - w[0].1);
    let mut steps: Vec<f64> = steps.filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}

fn scaled(factor: f64) -> &'static str {
    if factor < 0.0 {
        "has the opposite sign (--negate-torque where all have)"
    } else if factor < 1.0 {
        "is in mN·m"
    } else {
        "is in kN·m"
    }
}
