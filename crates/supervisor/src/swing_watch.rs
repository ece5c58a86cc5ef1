//! Whether a joint that is held swings by itself.
//!
//! A hold whose gains are too high for its delay swings its joint. Each half of a swing, from one turning point to the
//! next, is measured: its way, and the greatest and least torque of the motor. A hand that shakes a joint, or a blow
//! after which it rings, do work on the joint, and the hold takes it out again; a hold that swings does the work
//! itself. So the motor's work over a whole swing is summed as well, from motor angle and current of one instant,
//! whatever the delay of filters and commands.
//!
//! An integral gives energy even to a joint that a hand shakes slowly. Therefore the work that counts is that without
//! the integral's torque, unless the swing is a great one.

/// What counts as swinging.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwingWatchParameters {
    /// Least way between two turning points, rad: of a small swing, of one that needs fewer halves, and of a great
    /// one, whose integral counts.
    pub ways: [f64; 3],
    /// Greatest torque of the joint, N·m.
    pub torque: f64,
}

/// The motor's torque of one instant, N·m, link side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SwingTorque {
    /// By its current.
    pub motor: f64,
    /// What the hold's integral has of it.
    pub integral: f64,
}

/// Halves of swings in a row that make a swinging hold: of small swings, and of others.
const HALVES: [u32; 2] = [8, 3];
/// Share of the torque limit by which the motor must press more to one side than to the other: in small swings, and in
/// great ones. Chosen on the simulated test joint, with gains ten and thirty times too high at 250 Hz and 1 kHz
/// (`crates/cycle/tests/hold_swings.rs`).
const PRESSES: [f64; 2] = [0.1, 0.4];
/// Share of the way of the half before the last one that a half must have: the swing does not die away.
/// Chosen as [`PRESSES`].
const LASTS: f64 = 0.8;
/// Share of the least way by which the joint must come back from where it turns. Chosen as [`PRESSES`].
const TURNS: f64 = 0.1;
/// Longest time of a half, s: a joint that is slower is moved, and does not swing. Chosen as [`PRESSES`].
const LONGEST_S: f64 = 1.0;

/// What was measured of one half of a swing.
#[derive(Debug, Clone, Copy)]
struct Half {
    way: f64,
    /// Least and greatest torque, N·m.
    torques: [f64; 2],
    /// Work of the motor, N·m·rad: without the integral, and with it.
    work: [f64; 2],
    time_s: f64,
}

const EMPTY: Half = Half {
    way: 0.0,
    torques: [f64::INFINITY, f64::NEG_INFINITY],
    work: [0.0; 2],
    time_s: 0.0,
};

/// Follows one joint while it is held.
#[derive(Debug, Clone)]
pub struct SwingWatch {
    parameters: SwingWatchParameters,
    /// Angle and torque of the last cycle.
    last: Option<(f64, SwingTorque)>,
    /// The furthest angle since the last turning point, rad, and the direction in which it lies: 1 or -1.
    furthest: f64,
    direction: f64,
    /// The last turning point, rad.
    turned: f64,
    /// This half, and the two before.
    halves: [Half; 3],
    /// Halves in a row that are swings.
    count: u32,
    swings: bool,
}

impl SwingWatch {
    /// Watch of a joint that is not held yet.
    #[must_use]
    pub fn new(parameters: SwingWatchParameters) -> Self {
        Self {
            parameters,
            last: None,
            furthest: 0.0,
            direction: 1.0,
            turned: 0.0,
            halves: [EMPTY; 3],
            count: 0,
            swings: false,
        }
    }

    /// The joint is not held, or held anew.
    pub fn rest(&mut self) {
        *self = Self::new(self.parameters);
    }

    /// Whether the joint swings, or has since the watch began.
    #[must_use]
    pub fn swings(&self) -> bool {
        self.swings
    }

    /// Takes the joint's angle by its motor, rad, and the motor's torque of one instant, `dt` s after the ones
    /// before; true: it swings, from this cycle on. What is no number shows nothing.
    pub fn update(&mut self, angle: f64, torque: SwingTorque, dt: f64) -> bool {
        if !(angle.is_finite() && torque.motor.is_finite() && torque.integral.is_finite()) {
            return false;
        }
        let Some((angle_before, before)) = self.last.replace((angle, torque)) else {
            (self.furthest, self.turned) = (angle, angle);
            return false;
        };
        let [half, ..] = &mut self.halves;
        let (moved, motor) = (angle - angle_before, 0.5 * (torque.motor + before.motor));
        let integral = 0.5 * (torque.integral + before.integral);
        half.work[0] += (motor - integral) * moved;
        half.work[1] += motor * moved;
        half.time_s += dt;
        half.torques[0] = half.torques[0].min(torque.motor);
        half.torques[1] = half.torques[1].max(torque.motor);
        if self.direction * (angle - self.furthest) >= 0.0 {
            self.furthest = angle;
            return false;
        }
        if self.direction * (self.furthest - angle) < TURNS * self.parameters.ways[0] {
            return false;
        }
        let is_new = self.turn(angle) && !self.swings;
        self.swings |= is_new;
        is_new
    }

    /// The joint has turned round where it was furthest; true: it swings.
    fn turn(&mut self, angle: f64) -> bool {
        let [small, medium, great] = self.parameters.ways;
        self.halves[0].way = (self.furthest - self.turned).abs();
        let [now, before, same_side] = self.halves;
        let range = now.torques[1].max(before.torques[1]) - now.torques[0].min(before.torques[0]);
        let presses = PRESSES.map(|share| range > share * self.parameters.torque);
        let works = [0, 1].map(|i| now.work[i] + before.work[i] > 0.0);
        let drives = works[0] && presses[0] || works[1] && presses[1] && now.way >= great;
        let is_half = now.way >= small && now.time_s < LONGEST_S;
        let lasts = drives && now.way >= LASTS * same_side.way;
        self.count = match (is_half, self.count) {
            (false, _) => 0,
            // A first half has no half before it: only its way is known.
            (true, count @ 1..) if lasts => count + 1,
            (true, _) => 1,
        };
        (self.turned, self.furthest) = (self.furthest, angle);
        self.direction = -self.direction;
        self.halves = [EMPTY, now, before];
        let [many, few] = HALVES;
        let needed = if now.way >= medium { few } else { many };
        self.count >= needed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;
    const PARAMETERS: SwingWatchParameters = SwingWatchParameters {
        ways: [0.002, 0.008, 0.04],
        torque: 100.0,
    };

    /// Time after which a joint is found to swing, s; `torque`: of time, angle and velocity.
    fn found(
        angle: impl Fn(f64) -> f64,
        torque: impl Fn(f64, f64, f64) -> SwingTorque,
    ) -> Option<f64> {
        let mut watch = SwingWatch::new(PARAMETERS);
        (0..5000).map(|k| DT * f64::from(k)).find(|&t| {
            let velocity = (angle(t + DT) - angle(t)) / DT;
            watch.update(angle(t), torque(t, angle(t), velocity), DT)
        })
    }

    /// Swings so far to both sides at this many radians a second.
    fn swing(size: f64, rate: f64) -> impl Fn(f64) -> f64 {
        move |t| 0.3 + size * (rate * t).sin()
    }

    fn motor(motor: f64) -> SwingTorque {
        SwingTorque {
            motor,
            integral: 0.0,
        }
    }

    #[test]
    fn a_motor_that_swings_its_joint_is_found_within_its_first_swings() {
        // The spring's torque comes late, and drives what it should hold; the weight is carried besides.
        for (size, within) in [(0.02, 0.4), (0.002, 1.2)] {
            let at = swing(size, 31.4);
            let late = |t: f64, _: f64, _: f64| motor(20.0 - 5000.0 * (at(t - 0.03) - 0.3));
            let found = found(swing(size, 31.4), late);
            assert!(found.is_some_and(|t| t < within), "{size}: {found:?}");
        }
        // A swing that grows from nothing.
        let growing = |t: f64| 0.001 * (2.0 * t).exp() * (31.4 * t).sin();
        let driving = |_: f64, _: f64, v: f64| motor(20.0 + 40.0 * v);
        assert!(found(growing, driving).is_some());
    }

    #[test]
    fn a_hand_a_blow_and_a_small_swing_are_not() {
        let damped = |_: f64, x: f64, v: f64| motor(20.0 - 2000.0 * (x - 0.3) - 20.0 * v);
        assert_eq!(found(swing(0.02, 31.4), damped), None, "a hand shakes it");
        let ringing = |t: f64| 0.3 + 0.05 * (-4.0 * t).exp() * (31.4 * t).sin();
        let undamped = |_: f64, x: f64, v: f64| motor(20.0 - 2000.0 * (x - 0.3) + 1.0 * v);
        assert_eq!(found(ringing, undamped), None, "it rings after a blow");
        let driving = |_: f64, _: f64, v: f64| motor(100.0 * v);
        assert_eq!(found(swing(0.0005, 31.4), driving), None, "a small swing");
        let weak = |_: f64, _: f64, v: f64| motor(2.0 * v);
        assert_eq!(found(swing(0.004, 31.4), weak), None, "a small torque");
    }

    #[test]
    fn the_work_of_an_integral_counts_in_great_swings_alone() {
        // 2 Hz: the integral leads by a quarter, and does more work than the damper takes.
        let by_integral = |size: f64| {
            move |t: f64, x: f64, v: f64| {
                let integral = 2000.0 * 10.0 * size / 12.6 * (12.6 * t).cos();
                SwingTorque {
                    motor: 20.0 - 2000.0 * (x - 0.3) - 20.0 * v + integral,
                    integral,
                }
            }
        };
        assert_eq!(
            found(swing(0.004, 12.6), by_integral(0.004)),
            None,
            "a hand"
        );
        assert!(found(swing(0.1, 12.6), by_integral(0.1)).is_some());
    }
}
