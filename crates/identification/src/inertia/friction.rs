//! Terms of a joint's friction and drive, each linear in its coefficient.
//!
//! Coulomb, viscous and offset are always there; the others are offered to the selection on
//! held-out blocks: what wears, heats or stores in a gear differs from arm to arm.

/// A term of the torque of a joint beside that of its rigid bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Term {
    /// 1: offset of the torque.
    Offset,
    /// s(dq) = tanh(dq / v0): Coulomb friction.
    Coulomb,
    /// dq: viscous friction.
    Viscous,
    /// s(dq) exp(-(dq / (width v))^2): Stribeck's excess at low speed, width as a share of the
    /// joint's own speed v.
    Stribeck(f64),
    /// |dq| dq / v: grows faster than the speed.
    Quadratic,
    /// s(dq) sqrt(|dq| / v): grows slower than the speed, as grease does.
    SquareRoot,
    /// |dq|: viscous friction that differs by direction.
    Asymmetry,
    /// s(dq) |tau of the rigid bodies|: friction that grows with the load.
    Load,
    /// ddq: inertia of the rotor, link side.
    Rotor,
    /// Dahl's operator of the angle: friction that builds up over a way (rad or m), and stays at
    /// rest.
    Dahl(f64),
    /// q: a spring, such as a hose or cable.
    Spring,
}

/// Every term, in the order of the columns.
pub const TERMS: [Term; 15] = [
    Term::Offset,
    Term::Coulomb,
    Term::Viscous,
    Term::Stribeck(0.05),
    Term::Stribeck(0.15),
    Term::Stribeck(0.4),
    Term::Quadratic,
    Term::SquareRoot,
    Term::Asymmetry,
    Term::Load,
    Term::Rotor,
    Term::Dahl(0.003),
    Term::Dahl(0.02),
    Term::Dahl(0.1),
    Term::Spring,
];
/// The terms that every joint in motion has.
pub const ALWAYS: usize = 3;
/// Column of the rotor's inertia.
pub const ROTOR: usize = 10;
/// Column of the load's term: it depends on a fit, and is filled in later.
pub const LOAD: usize = 9;
/// Column of the Coulomb friction.
pub const COULOMB: usize = 1;
/// v0 as a share of the joint's speed.
const SMOOTH_SHARE: f64 = 0.02;

impl Term {
    /// True for terms whose coefficient cannot be negative.
    #[must_use]
    pub fn is_positive(self) -> bool {
        matches!(self, Self::Load | Self::Rotor | Self::Dahl(_))
    }

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Offset => "offset".into(),
            Self::Coulomb => "coulomb".into(),
            Self::Viscous => "viscous".into(),
            Self::Stribeck(width) => format!("stribeck_{width}"),
            Self::Quadratic => "quadratic".into(),
            Self::SquareRoot => "square_root".into(),
            Self::Asymmetry => "asymmetry".into(),
            Self::Load => "load".into(),
            Self::Rotor => "rotor_inertia".into(),
            Self::Dahl(way) => format!("dahl_{way}"),
            Self::Spring => "spring".into(),
        }
    }

    /// The term's factor, as a formula for users of the table.
    #[must_use]
    pub fn formula(self) -> String {
        match self {
            Self::Offset => "1".into(),
            Self::Coulomb => "s".into(),
            Self::Viscous => "dq".into(),
            Self::Stribeck(width) => format!("s exp(-(dq / ({width} v))^2)"),
            Self::Quadratic => "|dq| dq / v".into(),
            Self::SquareRoot => "s sqrt(|dq| / v)".into(),
            Self::Asymmetry => "|dq|".into(),
            Self::Load => "s |tau_rigid|".into(),
            Self::Rotor => "ddq".into(),
            Self::Dahl(way) => format!("z, where dz = (1 - z sign(dq)) dq dt / {way}"),
            Self::Spring => "q".into(),
        }
    }
}

/// A joint's terms over time.
#[derive(Debug, Clone)]
pub struct Friction {
    /// v: speed that the joint exceeds for a twentieth of the time that it moves, rad/s or m/s.
    pub speed: f64,
    /// True if it moves at all.
    pub moves: bool,
    /// True if its torque is the motor's, of which the rotor's inertia takes a part.
    pub motor: bool,
    states: [f64; TERMS.len()],
    last: Option<f64>,
}

impl Friction {
    /// Terms of a joint of the speed `v`.
    #[must_use]
    pub fn new(speed: f64, moves: bool, motor: bool) -> Self {
        Self {
            speed: speed.max(1e-6),
            moves,
            motor,
            states: [0.0; TERMS.len()],
            last: None,
        }
    }

    /// Forgets the way so far: a new stretch of the log begins.
    pub fn restart(&mut self) {
        self.states = [0.0; TERMS.len()];
        self.last = None;
    }

    /// s(dq), the smoothed sign.
    #[must_use]
    pub fn sign(&self, dq: f64) -> f64 {
        (dq / (SMOOTH_SHARE * self.speed)).tanh()
    }

    /// The terms at an instant, that of the load as if it were 1.
    pub fn terms(&mut self, q: f64, dq: f64, ddq: f64) -> [f64; TERMS.len()] {
        let (s, v) = (self.sign(dq), self.speed);
        let way = q - self.last.replace(q).unwrap_or(q);
        let mut out = [0.0; TERMS.len()];
        for ((value, term), state) in out.iter_mut().zip(TERMS).zip(&mut self.states) {
            *value = match term {
                Term::Offset => 1.0,
                Term::Coulomb | Term::Load => s,
                Term::Viscous => dq,
                Term::Stribeck(width) => s * (-(dq / (width * v)).powi(2)).exp(),
                Term::Quadratic => dq.abs() * dq / v,
                Term::SquareRoot => s * (dq.abs() / v).sqrt(),
                Term::Asymmetry => dq.abs(),
                Term::Rotor => ddq,
                Term::Spring => q,
                Term::Dahl(length) => {
                    let towards = if way < 0.0 { -1.0 } else { 1.0 };
                    *state = towards + (*state - towards) * (-way.abs() / length).exp();
                    *state
                }
            };
        }
        out
    }
}
