//! What the hold of a drive that takes currents must not do: swing its joint, or drive it where it is to stand.
//!
//! A hold whose gains are too high for its delay swings. Within its first swings this is event 414; from then on
//! nothing holds the joint but its weight's torque and its brake. In a fault, whatever its cause, no current acts along
//! a joint's motion: it brakes, or there is none. The velocity that counts is that of the newest samples, as that of a
//! filter is late by a good part of a swing, and that by which both encoders show the joint to move.

use robot_config::JointParameters;
use robot_state::{JointMeasured, measured_flags};
use supervisor::{SwingTorque, SwingWatch, SwingWatchParameters};

use super::carry::smaller;

/// Ways between two turning points of a swing, rad: of small, medium and great ones. A medium one is a swing of 0.2
/// degrees to each side. Chosen on the simulated test joint (`crates/cycle/tests/hold_swings.rs`).
const WAYS: [f64; 3] = [0.1 * DEGREE, 0.4 * DEGREE, 2.0 * DEGREE];
const DEGREE: f64 = core::f64::consts::PI / 180.0;
/// Velocity from which on a joint moves, over that of rest: as `SLOW` of carry.rs.
const MOVES: f64 = 2.5;
/// Cycles over which the newest velocity is taken.
const SPAN: usize = 4;

/// Watches the hold of one joint.
#[derive(Debug, Clone)]
pub(super) struct HoldGuard {
    watch: SwingWatch,
    /// Angles of the last cycles by motor and link, rad, the newest first.
    angles: [[f64; 2]; SPAN + 1],
    /// Number of `angles` that are known.
    known: usize,
    /// The joint's velocity by them, rad/s.
    velocity: f64,
    /// The joint swings, and that has not been reported.
    is_news: bool,
    moves: f64,
    torque_per_current: f64,
}

impl HoldGuard {
    pub(super) fn new(joint: &JointParameters) -> Self {
        Self {
            watch: SwingWatch::new(SwingWatchParameters {
                ways: WAYS.map(|way| joint.kind.threshold(way)),
                torque: joint.limits.torque,
            }),
            angles: [[0.0; 2]; SPAN + 1],
            known: 0,
            velocity: 0.0,
            is_news: false,
            moves: MOVES * joint.limits.rest,
            torque_per_current: joint.encoders.gear_ratio
                * joint.estimator.wave_generator.torque_constant,
        }
    }

    /// The joint is not held.
    pub(super) fn rest(&mut self) {
        self.watch.rest();
        self.known = 0;
        self.velocity = 0.0;
    }

    /// Takes a cycle in which the joint is held or stopped; `shown`: angles by motor and link as they were read,
    /// trusted or not, rad; `integral`: torque of the hold's integral, N·m.
    pub(super) fn observe(
        &mut self,
        measured: &JointMeasured,
        shown: [f64; 2],
        integral: f64,
        dt: f64,
    ) {
        if measured.flags & measured_flags::MISSED != 0 {
            return;
        }
        self.angles.rotate_right(1);
        self.angles[0] = shown;
        self.known = (self.known + 1).min(SPAN + 1);
        let [now, then] = [self.angles[0], self.angles[SPAN]];
        let [motor, link] = [0, 1].map(|i| (now[i] - then[i]) / (SPAN as f64 * dt));
        self.velocity = if self.known > SPAN {
            smaller(link, motor)
        } else {
            0.0
        };
        let torque = SwingTorque {
            motor: self.torque_per_current * measured.current,
            integral,
        };
        self.is_news |= self.watch.update(shown[0], torque, dt);
    }

    /// The hold swings its joint, or did so since it began.
    pub(super) fn swings(&self) -> bool {
        self.watch.swings()
    }

    /// To be asked once a cycle: the hold has begun to swing its joint.
    pub(super) fn take_news(&mut self) -> bool {
        core::mem::take(&mut self.is_news)
    }

    /// A command acts along the motion of a joint that is to stop, or that its hold has swung.
    pub(super) fn forbids(&self, command: f64, stops: bool) -> bool {
        let drives = self.velocity.abs() > self.moves && command * self.velocity > 0.0;
        drives && (stops || self.swings())
    }
}
