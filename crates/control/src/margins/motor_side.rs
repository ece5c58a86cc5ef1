//! Margins of the feedback of a late torque, of joints without a link-side encoder.
//!
//! As for the predictive law the loop is opened at the motor's torque, inside the drive. It is linear, and its
//! parts are known as frequency responses: gear, rotor and link, the drive, its lag and the way of a command, and
//! of the law the taps of its filters. With the motor's torque `m` on the rotor,
//!
//! ```text
//! theta = P m        T = Z theta: torque of the gear against the load
//! tau_hat = H T      q = theta - F tau_hat / K      tau_d = -(K_s + K_d V) q
//! tau* = tau_d + (K_p + K_i / s) (H R tau_d - tau_hat)
//! u = theta + tau* / k_d + K_v V theta              made = lag (k_d (D u - theta) - d_d s theta)
//! ```
//!
//! and `-made / m` is the open loop: `H` and `V` the taps of the torque's and the velocities' filters, `R` the lag
//! of the joint's own torque, `F` the two low-passes of the explained torsion, `D` transport and hold. No pole of
//! it lies right of the imaginary axis, so the closed loop is stable where `1 + L` turns by as many quarters as it
//! has poles at zero, two of a free load and one of the integral (Nyquist).

use super::response::{Delays, Point, fallen_by_3_db, nyquist, sampled};
use super::{Load, Margins, all_keep, largest, least};
use crate::gains::JointGains;
use crate::predictive::{DriveLoop, LawParameters};
use nalgebra::Complex;

/// A joint whose torque is fed back late.
#[derive(Debug, Clone, PartialEq)]
pub struct MotorSideLoop {
    /// Joint and drive.
    pub law: LawParameters,
    /// Part of the delay that is within the drive, s.
    pub drive_lag: f64,
    /// Inertia of the link, kg·m².
    pub link_inertia: f64,
    /// Torque that the joint carries, N·m: it determines the gear's stiffness.
    pub torque: f64,
    /// K_p, K_i, K_s, K_d.
    pub gains: JointGains,
    /// Weights of the samples in the torque's filters, oldest first.
    pub smoothing: Vec<f64>,
    /// Weights of the angles in the velocity that control uses, oldest first, 1/s.
    pub velocity: Vec<f64>,
    /// Bandwidth of the explained torsion, rad/s.
    pub torsion_bandwidth: f64,
}

/// Damping of the gear as a share of that which is critical for the rotor. Chosen on the simulated leg, whose gears
/// have it (config/leg/sim.toml).
const GEAR_DAMPING: f64 = 0.02;
/// Least K_i that is looked for, 1/s: a feedback of less needs longer than 2 s. Chosen; no experiment recorded.
const LEAST_K_I: f64 = 0.5;

/// Responses at one frequency, per torque of the motor.
struct Signals {
    made: Complex<f64>,
    /// Gear's torque per desired torque, the loop being closed.
    torque: Complex<f64>,
}

impl MotorSideLoop {
    /// The open loop's response with a load: -1 is the critical point.
    #[must_use]
    pub fn open_loop(&self, load: Load) -> Vec<Point> {
        sampled(self.law.sample_period, |w| -self.signals(w, load).made)
    }

    /// The closed loop's response, from the desired torque to the torque of the gear.
    #[must_use]
    pub fn torque_response(&self, load: Load) -> Vec<Point> {
        sampled(self.law.sample_period, |w| self.signals(w, load).torque)
    }

    /// Frequency at which the torque response has fallen by 3 dB, Hz.
    #[must_use]
    pub fn bandwidth(&self, load: Load) -> f64 {
        fallen_by_3_db(&self.torque_response(load))
    }

    /// Gain and phase margin with a load.
    #[must_use]
    pub fn margins(&self, load: Load) -> Margins {
        let g = &self.gains;
        // 1/s³ by K_i K_s on a free inertia, 1/s² by K_s, or K_i K_d; 1/s by K_i, K_d, or the way of a command
        // that goes along with a rotor.
        let integral = u8::from(g.k_i > 0.0);
        let poles = if !Load::MOVING.contains(&load) {
            integral
        } else if g.k_s > 0.0 {
            2 + integral
        } else if g.k_d > 0.0 {
            1 + integral
        } else {
            1
        };
        let open = |w| -self.signals(w, load).made;
        nyquist(poles, self.law.sample_period, open)
    }

    /// The loop without stiffness and damping in space: the torque's alone.
    #[must_use]
    pub fn of_torque(&self) -> Self {
        self.with_space(0.0, 0.0)
    }

    /// The loop with these K_s, N·m/rad, and K_d, N·m·s/rad.
    #[must_use]
    pub fn with_space(&self, k_s: f64, k_d: f64) -> Self {
        self.with_gains(JointGains {
            k_s,
            k_d,
            ..self.gains
        })
    }

    fn with_gains(&self, gains: JointGains) -> Self {
        Self {
            gains,
            ..self.clone()
        }
    }

    /// The least margins over some loads, each with the load at which it occurs.
    #[must_use]
    pub fn least_margins(&self, loads: &[Load]) -> (Margins, [Load; 2]) {
        least(loads, |load| self.margins(load))
    }

    /// Whether these margins are kept: of the torque's loop with every load, and with K_s and K_d of every load that
    /// moves.
    #[must_use]
    pub fn keeps(&self, needed: Margins) -> bool {
        let of_torque = self.of_torque();
        all_keep(&Load::ALL, needed, |load| of_torque.margins(load))
            && all_keep(&Load::MOVING, needed, |load| self.margins(load))
    }

    /// The largest K_i up to `most`, 1/s, at which every load keeps these margins; zero if there is none.
    #[must_use]
    pub fn largest_k_i(&self, most: f64, needed: Margins) -> f64 {
        largest(LEAST_K_I, most, |k_i| {
            let gains = JointGains { k_i, ..self.gains };
            self.with_gains(gains).keeps(needed)
        })
    }

    /// The largest stiffness in space, N·m/rad, with a damping of `ratio` (s) times that stiffness, at which the
    /// moving loads keep these margins; zero if there is none.
    #[must_use]
    pub fn largest_stiffness(&self, ratio: f64, needed: Margins) -> f64 {
        let scale = self.law.drive_stiffness();
        largest(scale * 0.02, scale * 2.0, |k_s| {
            let tried = self.with_space(k_s, ratio * k_s);
            all_keep(&Load::MOVING, needed, |load| tried.margins(load))
        })
    }

    /// The largest damping in space, N·m·s/rad, without stiffness, at which the moving loads keep these margins;
    /// zero if there is none.
    #[must_use]
    pub fn largest_damping(&self, needed: Margins) -> f64 {
        let scale = 0.1 * self.law.drive_stiffness();
        largest(scale * 0.002, scale, |k_d| {
            let tried = self.with_space(0.0, k_d);
            all_keep(&Load::MOVING, needed, |load| tried.margins(load))
        })
    }

    fn signals(&self, w: f64, load: Load) -> Signals {
        let one = Complex::new(1.0, 0.0);
        let s = Complex::new(0.0, w);
        let (law, g, period) = (&self.law, &self.gains, self.law.sample_period);
        let delays = Delays::new(w, period);
        let gear = law.gear.at(self.torque);
        let DriveLoop::Position {
            stiffness: k_d,
            damping: d_d,
            ..
        } = law.drive
        else {
            // Refused by the configuration.
            let none = Complex::new(f64::NAN, 0.0);
            return Signals {
                made: none,
                torque: none,
            };
        };
        let (theta, torque) = self.mechanics(w, load);

        let last = delays.of(period);
        let h = delays.taps(&self.smoothing);
        let rate = delays.taps(&self.velocity);
        // Transfer function of a first-order lag as the law steps it: backward Euler.
        let backwards = |time: f64| {
            let share = period / (period + time);
            one * share / (one - last * (1.0 - share))
        };
        let r = backwards(law.torque_lag());
        let low = backwards(1.0 / self.torsion_bandwidth);
        let transport = delays.hold() * delays.of((law.delay - self.drive_lag).max(0.0));
        let feedback = one * g.k_p + delays.sum(period) * g.k_i;

        // The torsion of the last cycle.
        let q = theta - low * low * h * last * torque / gear;
        let tau_d = -(one * g.k_s + rate * g.k_d) * q;
        let follow = one + feedback * h * r;
        let tau_star = tau_d * follow - feedback * h * torque;
        let k_v = d_d / k_d;
        let lead = tau_star / k_d + rate * theta * k_v;
        let lag = delays.of(self.drive_lag);
        let braked = s * theta * d_d / (one + s * (2.0 * self.drive_lag));
        let made = lag * (((theta + lead) * transport - theta) * k_d - braked);
        Signals {
            made,
            // m = made(m) + lag transport follow tau_d
            torque: torque * follow * transport * lag / (one - made),
        }
    }

    /// Angle of the motor, and torque of the gear, per torque on the rotor.
    fn mechanics(&self, w: f64, load: Load) -> (Complex<f64>, Complex<f64>) {
        let (one, s) = (Complex::new(1.0, 0.0), Complex::new(0.0, w));
        let (gear, inertia) = (self.law.gear.at(self.torque), self.law.rotor_inertia);
        let damped = 2.0 * GEAR_DAMPING * (gear * inertia).sqrt();
        let spring = one * gear + s * damped;
        // Load, as torque per angle of the link; none where that is blocked.
        let mass = s * s * (load.inertia_share() * self.link_inertia);
        let held = match load {
            Load::Blocked | Load::Stuck => None,
            Load::Spring => Some(mass + (one + s * 1e-3) * (gear / 3.0)),
            _ => Some(mass),
        };
        let stick = if load == Load::Stuck {
            super::STUCK * gear
        } else {
            0.0
        };
        let z = held.map_or(spring, |held| spring * held / (spring + held));
        let theta = one / (s * s * inertia + z + stick);
        (theta, z * theta)
    }
}
