//! The drive: P on the angle asks for a velocity, P on its error for a current, at a sample of its own; then a current
//! loop, whose torque ripples. Angles and torques on the link side.

use std::f64::consts::TAU;

/// How the drive knows its velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Velocity {
    /// Difference over so many of its samples.
    Difference(usize),
    /// Difference of one sample through a low-pass of this time constant, s.
    LowPass(f64),
}

impl Velocity {
    pub(crate) fn name(self) -> String {
        match self {
            Self::Difference(over) => format!("{over} samples"),
            Self::LowPass(time) => format!("a low-pass of {:.2} ms", 1e3 * time),
        }
    }
}

/// Sizes of a drive.
#[derive(Debug, Clone)]
pub(crate) struct Sizes {
    /// k_d: N·m/rad.
    pub(crate) stiffness: f64,
    /// d_d: N·m·s/rad.
    pub(crate) damping: f64,
    /// Errors below this make no torque, rad.
    pub(crate) dead_zone: f64,
    /// Steps of the simulation in one of its samples, and the first one.
    pub(crate) every: usize,
    pub(crate) phase: usize,
    pub(crate) velocity: Velocity,
    /// Its current acts one of its samples later, as it is computed from one sample to the next.
    pub(crate) late: bool,
    /// Order of the current loop, 1 or 2, and its time constant, s.
    pub(crate) order: usize,
    pub(crate) lag: f64,
    /// Torque of its greatest current, N·m.
    pub(crate) limit: f64,
    /// Ripple of the torque: share, periods in a turn of the motor, phase.
    pub(crate) ripple: (f64, f64, f64),
    /// Count of the angle by which it controls, rad.
    pub(crate) count: f64,
}

impl Sizes {
    /// Time from a set-point to the middle of what its current loop makes of it, s: half a sample, what is computed
    /// late, and the current loop.
    pub(crate) fn mean_lag(&self, dt: f64) -> f64 {
        let sample = self.every as f64 * dt;
        let late = if self.late { sample } else { 0.0 };
        0.5 * sample + late + self.order as f64 * self.lag
    }

    /// Time by which its velocity is late, s.
    pub(crate) fn velocity_lag(&self, dt: f64) -> f64 {
        let sample = self.every as f64 * dt;
        match self.velocity {
            Velocity::Difference(over) => 0.5 * over as f64 * sample,
            Velocity::LowPass(time) => 0.5 * sample + time,
        }
    }
}

/// A drive with its loops.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    pub(crate) sizes: Sizes,
    pub(crate) set_point: f64,
    step: usize,
    angles: [f64; 5],
    velocity: f64,
    asked: f64,
    next: f64,
    stages: [f64; 2],
}

impl Drive {
    /// At rest at an angle, carrying a torque.
    pub(crate) fn at_rest(sizes: Sizes, angle: f64, torque: f64) -> Self {
        let zone = if torque == 0.0 {
            0.0
        } else {
            sizes.dead_zone.copysign(torque)
        };
        Self {
            set_point: angle + torque / sizes.stiffness + zone,
            step: sizes.phase,
            angles: [angle; 5],
            velocity: 0.0,
            asked: torque,
            next: torque,
            stages: [torque; 2],
            sizes,
        }
    }

    /// Torque by which its current shows, N·m.
    pub(crate) fn by_current(&self) -> f64 {
        self.stages[self.sizes.order - 1]
    }

    /// A step of `dt` with the motor at `angle`, of which `motor` is its own; the torque of its motor, N·m.
    pub(crate) fn advance(&mut self, angle: f64, motor: f64, dt: f64) -> f64 {
        if self.step == 0 {
            self.sample(angle, dt);
        }
        self.step = (self.step + 1) % self.sizes.every;
        let share = dt / (dt + self.sizes.lag);
        self.stages[0] += share * (self.asked - self.stages[0]);
        self.stages[1] += share * (self.stages[0] - self.stages[1]);
        let (ripple, periods, phase) = self.sizes.ripple;
        self.by_current() * (1.0 + ripple * (periods * motor + phase).sin())
    }

    fn sample(&mut self, angle: f64, dt: f64) {
        let s = &self.sizes;
        let period = s.every as f64 * dt;
        let counted = (angle / s.count).round() * s.count;
        self.angles.rotate_right(1);
        self.angles[0] = counted;
        self.velocity = match s.velocity {
            Velocity::Difference(over) => (counted - self.angles[over]) / (over as f64 * period),
            Velocity::LowPass(time) => {
                let raw = (counted - self.angles[1]) / period;
                self.velocity + period / (period + time) * (raw - self.velocity)
            }
        };
        let error = self.set_point - counted;
        let outside = error - error.clamp(-s.dead_zone, s.dead_zone);
        // P on the angle asks for a velocity, and P on its error for the current.
        let asked_velocity = s.stiffness / s.damping * outside;
        let torque = s.damping * (asked_velocity - self.velocity);
        let torque = torque.clamp(-s.limit, s.limit);
        self.asked = if s.late { self.next } else { torque };
        self.next = torque;
    }
}

/// Angle of a whole turn on the motor's side in counts of so many, on the link's side, rad.
pub(crate) fn count(per_turn: f64, ratio: f64) -> f64 {
    TAU / per_turn / ratio
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 25e-6;

    fn sizes(every: usize, late: bool) -> Sizes {
        Sizes {
            stiffness: 8000.0,
            damping: 60.0,
            dead_zone: 0.0,
            every,
            phase: 3,
            velocity: Velocity::Difference(2),
            late,
            order: 2,
            lag: 1e-4,
            limit: 50.0,
            ripple: (0.0, 6.0, 0.0),
            count: 1e-7,
        }
    }

    /// The angle of a rotor of 0.2 kg·m², which nothing else holds, after a step of the set-point, each millisecond.
    fn step(sizes: Sizes, size: f64) -> Vec<f64> {
        let mut drive = Drive::at_rest(sizes, 0.0, 0.0);
        drive.set_point = size;
        let (mut angle, mut v) = (0.0, 0.0);
        let steps = 0..4000;
        let mut angles = Vec::new();
        for k in steps {
            v += DT / 0.2 * drive.advance(angle, 0.0, DT);
            angle += DT * v;
            if k % 40 == 39 {
                angles.push(angle);
            }
        }
        angles
    }

    /// The ideal loop of this rotor: 200 rad/s and a damping ratio of 0.75.
    #[test]
    fn a_step_is_that_of_its_stiffness_and_damping() {
        let angles = step(sizes(10, false), 1e-3);
        let end = angles[99] / 1e-3;
        assert!((end - 1.0).abs() < 1e-3, "{end}");
        let over = angles.iter().copied().fold(0.0, f64::max) / 1e-3 - 1.0;
        assert!((0.005..0.06).contains(&over), "{over}");
        let half = angles.iter().position(|x| *x > 0.5e-3).unwrap();
        assert!((7..=9).contains(&half), "{half}");
    }

    #[test]
    fn slower_samples_make_it_overshoot_more_and_the_limit_holds() {
        let over = |sizes: Sizes| step(sizes, 1e-3).into_iter().fold(0.0, f64::max) / 1e-3;
        let over = [(10, false), (40, true)].map(|(every, late)| over(sizes(every, late)));
        assert!(over[0] + 0.01 < over[1], "{over:?}");
        // 50 N·m on 0.2 kg·m² for 20 ms: no further than 50 mrad.
        let far = step(sizes(10, false), 1.0)[19];
        assert!((0.04..0.05).contains(&far), "{far}");
    }
}
