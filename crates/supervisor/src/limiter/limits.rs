//! What a joint and its drive allow.

/// Limits of a joint. All positive; infinite where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Least position, rad.
    pub position_min: f64,
    /// Greatest position, rad.
    pub position_max: f64,
    /// Greatest |dq|, rad/s.
    pub velocity: f64,
    /// Deceleration with which the joint can always be stopped, rad/s².
    pub deceleration: f64,
    /// Greatest |tau|, N·m.
    pub torque: f64,
    /// Greatest change of tau, N·m/s.
    pub torque_rate: f64,
    /// Greatest tau dq, W: power given to the link.
    pub power: f64,
    /// Greatest lead of a command over the measured position, rad, where it is less than the
    /// torque limit's.
    pub lead: f64,
    /// |dq| below which the joint counts as at rest, rad/s.
    pub rest: f64,
    /// Greatest way by which a held set-point gives way to a load, rad.
    pub gives_way: f64,
    /// How the limiter brakes the joint itself.
    pub braking: Braking,
}

/// How the limiter brakes a joint whose drive takes currents. One that takes positions brakes by its own loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Braking {
    /// Torque that brakes, per velocity, N·m·s/rad. The rotor's inertia (link side) over twice
    /// the delay of the measured velocity brakes as hard as that delay allows.
    pub damping: f64,
    /// Time that braking takes to act, s: with eight times the greatest inertia at the joint
    /// over `damping` a position limit is approached without overshoot.
    pub time: f64,
    /// Time in which a joint beyond a position limit is to return, s: with `damping` it makes
    /// the stiffness of the limit.
    pub return_time: f64,
}

impl Braking {
    /// Braking of a drive that takes positions: it acts at once, and no joint is made to return.
    pub const BY_DRIVE: Self = Self {
        damping: f64::INFINITY,
        time: 0.0,
        return_time: f64::INFINITY,
    };
}
