//! Parameters of the predictive torque law, link side.

use super::friction::FrictionModel;
use crate::DriveModel;
use std::f64::consts::TAU;

/// Parameters of a joint and its drive. Angles, torques and inertias on the link side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawParameters {
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Time from a sample until the torque answers the command computed from it, s: bus and the
    /// drive's own lag.
    pub delay: f64,
    /// The drive.
    pub drive: DriveLoop,
    /// J: inertia of the rotor, J_m N², kg·m².
    pub rotor_inertia: f64,
    /// The gear.
    pub gear: GearStiffness,
    /// Friction on the rotor that is foreseen.
    pub friction: FrictionModel,
    /// Largest |tau_d|, N·m.
    pub torque_limit: f64,
    /// Largest |d| that is believed, N·m.
    pub disturbance_limit: f64,
    /// Bandwidths and damping.
    pub design: Design,
}

/// The loop that makes a drive's torque by its command, as the law computes with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DriveLoop {
    /// Position-commanded: `m = k_d (u - theta) - d_d omega + z`, no torque within the dead zone. `z` is the integral
    /// of a velocity loop that has one (P-PI): `z' = (m - z) / T_i`, since it integrates what the rest makes.
    Position {
        /// k_d: stiffness of the position loop, N·m/rad.
        stiffness: f64,
        /// d_d: damping of the position loop, N·m·s/rad.
        damping: f64,
        /// Errors below this make no torque, rad.
        dead_zone: f64,
        /// 1/T_i: rate of the velocity loop's integral, 1/s; 0: it has none.
        integral: f64,
    },
    /// Current-commanded: `m = K_t N i - d omega`.
    Current {
        /// K_t N: torque per current, N·m/A.
        torque_constant: f64,
        /// d: viscous friction, N·m·s/rad.
        viscous: f64,
    },
}

impl From<&DriveModel> for DriveLoop {
    fn from(drive: &DriveModel) -> Self {
        match drive {
            DriveModel::Position(drive) => Self::Position {
                stiffness: 1.0 / drive.k_tau_motor,
                damping: drive.k_v / drive.k_tau_motor,
                dead_zone: drive.dead_zone,
                integral: drive.integral,
            },
            DriveModel::Current(drive) => Self::Current {
                torque_constant: drive.k_1,
                viscous: drive.k_2,
            },
        }
    }
}

/// Stiffness of a harmonic drive by its torque (Z 10, Z 13): flexspline and wave generator in
/// series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearStiffness {
    /// K_fs0: stiffness of the unloaded flexspline, N·m/rad.
    pub k_fs0: f64,
    /// C_fs: its stiffening, 1/(N·m).
    pub c_fs: f64,
    /// K_wg0 N²: stiffness of the unloaded wave generator on the link side, N·m/rad; infinite for
    /// a rigid one.
    pub k_wg0: f64,
    /// C_wg / N: its stiffening on the link side, 1/(N·m).
    pub c_wg: f64,
}

/// Bandwidths and damping of the law. The default is the same for every joint; more help is chosen where the loop
/// bears it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Design {
    /// Bandwidth of the rotor observer, rad/s.
    pub rotor: f64,
    /// Bandwidth of the link observer, rad/s.
    pub link: f64,
    /// Bandwidth of the link velocity that the drive's damping goes along with, rad/s.
    pub follow: f64,
    /// Bandwidth of the reference model, rad/s.
    pub reference: f64,
    /// s: stiffness of the loop over that of drive and gear.
    pub stiffness: f64,
    /// zeta: damping ratio of the loop.
    pub damping: f64,
    /// Bandwidth of the quicker estimates of the link's velocity, by which a hand is helped, rad/s.
    pub assist_bandwidth: f64,
    /// s_h: share of what they ask for and of the torque's error that helps a hand; 0: nothing does.
    pub assist: f64,
}

impl Default for Design {
    fn default() -> Self {
        Self {
            rotor: TAU * 40.0,
            link: TAU * 25.0,
            follow: TAU * 10.0,
            reference: TAU * 60.0,
            stiffness: 1.0,
            damping: 1.0,
            assist_bandwidth: TAU * 32.0,
            assist: 2.5,
        }
    }
}

/// Parts of a desired torque, N·m (D12).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TorqueTerms {
    /// Term of the desired motion and contact forces.
    pub feedforward: f64,
    /// Term of the position error.
    pub position: f64,
    /// Term of the velocity error.
    pub velocity: f64,
    /// Term of the contact force's error.
    pub force: f64,
}

impl TorqueTerms {
    /// Sum of the four terms.
    #[must_use]
    pub fn sum(&self) -> f64 {
        self.feedforward + self.force + self.position + self.velocity
    }

    /// Feed-forward, position, velocity, force; all smaller by the same share where the sum exceeds
    /// the limit.
    pub(super) fn within(&self, limit: f64) -> [f64; 4] {
        let sum = self.sum();
        let share = if sum.abs() > limit {
            limit / sum.abs()
        } else {
            1.0
        };
        [self.feedforward, self.position, self.velocity, self.force].map(|term| share * term)
    }
}

/// A command and what it is made of (D 5.5): the six contributions and `origin` add up to it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contributions {
    /// Commanded position, rad, or current, A.
    pub command: f64,
    /// tau_d within the torque limit, N·m.
    pub desired: f64,
    /// Torque that the motor is to produce besides friction, N·m.
    pub motor_torque: f64,
    /// Share of the torque feed-forward in the command, rad or A.
    pub feedforward_torque: f64,
    /// Share of friction in the command: drive's damping, disturbance, dead zone.
    pub feedforward_friction: f64,
    /// Share of the position error in the command.
    pub feedback_position: f64,
    /// Share of the velocity error in the command.
    pub feedback_velocity: f64,
    /// Share of the contact force's error in the command.
    pub feedback_force: f64,
    /// Share of the torque's own error in the command: zero where torque and model agree and the joint rests.
    pub feedback_torque: f64,
    /// q for a position-commanded drive, rad; else zero.
    pub origin: f64,
}

impl GearStiffness {
    /// A gear of constant stiffness, N·m/rad.
    #[must_use]
    pub fn constant(stiffness: f64) -> Self {
        Self {
            k_fs0: stiffness,
            c_fs: 0.0,
            k_wg0: f64::INFINITY,
            c_wg: 0.0,
        }
    }

    /// k: stiffness at a torque, N·m/rad.
    #[must_use]
    pub fn at(&self, torque: f64) -> f64 {
        let fs = self.k_fs0 * (1.0 + (self.c_fs * torque).powi(2));
        let wg = self.k_wg0 * (self.c_wg * torque.abs()).min(20.0).exp();
        // Flexspline and wave generator in series; a rigid wave generator leaves the flexspline.
        fs / (1.0 + fs / wg)
    }
}

impl LawParameters {
    /// Lag of the gear's torque behind the desired one where commands are relative to the rotor, s:
    /// half a period of hold, the way to the drive, and the gear that is wound up against the drive's
    /// damping, to which the delay of such a command adds.
    #[must_use]
    pub fn torque_lag(&self) -> f64 {
        let rotor = self.rotor_damping() + self.drive_stiffness() * self.delay;
        let wound_up = rotor / self.gear.k_fs0;
        0.5 * self.sample_period + self.delay + wound_up
    }

    /// Lag of the torque behind the desired one, s: the reference model's, and half a period of hold.
    #[must_use]
    pub fn reference_lag(&self) -> f64 {
        2.0 * super::reference::DAMPING / self.design.reference + 0.5 * self.sample_period
    }

    /// Inertia that the link feels besides its own, kg·m²: the law lets the drive's damping go along with
    /// slow velocities; from `follow` on it brakes, which is what an inertia does. Of a torque that brings the motor up
    /// to it, `K/k T`, the help for a hand takes `s_h T`.
    #[must_use]
    pub fn effective_inertia(&self) -> f64 {
        let gear = self.gear.at(0.0);
        let helped = 1.0 + self.design.assist * gear / self.feedback(gear).0;
        match self.drive {
            DriveLoop::Position { damping, .. } => damping / self.design.follow / helped,
            DriveLoop::Current { .. } => 0.0,
        }
    }

    /// Whole periods of the delay, and the rest, s.
    pub(super) fn delay_in_cycles(&self) -> (usize, f64) {
        let dt = self.sample_period;
        let cycles = (self.delay / dt + 1e-9).floor().max(0.0);
        let lag = (self.delay - cycles * dt).clamp(0.0, dt);
        (cycles as usize, lag)
    }

    /// k_d: stiffness of the drive's position loop, N·m/rad; zero for a current-commanded drive.
    #[must_use]
    pub fn drive_stiffness(&self) -> f64 {
        match self.drive {
            DriveLoop::Position { stiffness, .. } => stiffness,
            DriveLoop::Current { .. } => 0.0,
        }
    }

    /// Damping of the rotor against the world, N·m·s/rad.
    pub(super) fn rotor_damping(&self) -> f64 {
        match self.drive {
            DriveLoop::Position { damping, .. } => damping,
            DriveLoop::Current { viscous, .. } => viscous,
        }
    }

    /// K and D: stiffness and damping that the law gives the torsion, with a gear of `stiffness`.
    #[must_use]
    pub fn feedback(&self, stiffness: f64) -> (f64, f64) {
        let k = self.design.stiffness * (self.drive_stiffness() + stiffness);
        (
            k,
            2.0 * self.design.damping * (k * self.rotor_inertia).sqrt(),
        )
    }

    /// Torque of the motor without damping, with a command: for a position-commanded drive that of
    /// its spring, whose own end moves with the rotor.
    #[must_use]
    pub fn motor_torque(&self, command: f64, theta: f64) -> f64 {
        match self.drive {
            DriveLoop::Position {
                stiffness,
                dead_zone,
                ..
            } => {
                let error = command - theta;
                // max and min, not clamp: they cannot panic.
                stiffness * (command - error.max(-dead_zone).min(dead_zone))
            }
            DriveLoop::Current {
                torque_constant, ..
            } => torque_constant * command,
        }
    }

    /// 1/T_i: rate of the integral in the drive's velocity loop, 1/s; 0: it has none.
    #[must_use]
    pub fn drive_integral(&self) -> f64 {
        match self.drive {
            DriveLoop::Position { integral, .. } => integral,
            DriveLoop::Current { .. } => 0.0,
        }
    }

    /// z after `time`, s, at which `command` has acted on a rotor that is at `theta` and moves with `omega` by then.
    pub(super) fn wound_up(
        &self,
        z: f64,
        (command, time): (f64, f64),
        [theta, omega]: [f64; 2],
    ) -> f64 {
        let rate = self.drive_integral();
        if rate == 0.0 {
            return 0.0;
        }
        let spring = self.motor_torque(command, theta) - self.drive_stiffness() * theta;
        z + rate * time * (spring - self.rotor_damping() * omega)
    }

    /// The command that carries `torque` at rest: where the motor is, if the drive integrates.
    pub(super) fn command_for(&self, torque: f64, theta: f64) -> f64 {
        let lead = self.command_per_torque() * torque;
        match self.drive {
            DriveLoop::Position { integral, .. } if integral > 0.0 => theta,
            DriveLoop::Position { dead_zone, .. } if torque != 0.0 => {
                theta + lead + dead_zone.copysign(torque)
            }
            DriveLoop::Position { .. } => theta,
            DriveLoop::Current { .. } => lead,
        }
    }

    pub(super) fn command_per_torque(&self) -> f64 {
        match self.drive {
            DriveLoop::Position { stiffness, .. } => 1.0 / stiffness,
            DriveLoop::Current {
                torque_constant, ..
            } => 1.0 / torque_constant,
        }
    }

    /// The angle from which a position-commanded drive's lead counts; zero for a current.
    pub(super) fn measured_origin(&self, angle: f64) -> f64 {
        match self.drive {
            DriveLoop::Position { .. } => angle,
            DriveLoop::Current { .. } => 0.0,
        }
    }

    /// Torque against the drive's damping that motion with the link costs. A position-commanded
    /// drive goes along with the link's slow velocity only: in the quick one delay would make it
    /// push.
    pub(super) fn carried_damping(&self, slow_velocity: f64, omega: f64) -> f64 {
        match self.drive {
            DriveLoop::Position { damping, .. } => damping * slow_velocity,
            DriveLoop::Current { viscous, .. } => viscous * omega,
        }
    }

    /// Velocity from which on a measured motion, that no reference asks for, has all of the foreseen friction, rad/s.
    /// With the sign of any measured velocity it would drive the joint by itself where the true friction turns round on
    /// a shorter way than the foreseen one: what is late of it comes back through the observer later still, and both
    /// feed a swing that never ends. Below this velocity it is a negative damping, two thirds of the drive's own.
    fn sliding_velocity(&self) -> f64 {
        // Chosen on the simulated leg and humanoid, and on a UR5 in MuJoCo (docs/control-law.md, Friction that is
        // foreseen).
        const SHARE: f64 = 2.0 / 3.0;
        let damping = match self.drive {
            DriveLoop::Position { damping, .. } => damping,
            DriveLoop::Current { .. } => self.rotor_inertia * self.design.rotor,
        };
        (self.friction.level / (SHARE * damping)).max(1e-6)
    }

    /// Share of the foreseen friction that a measured motion has, by what it turns the rotor by in a period, 1/rad.
    pub(super) fn per_sliding_way(&self) -> f64 {
        1.0 / (self.sample_period * self.sliding_velocity())
    }

    /// Torque against the drive's damping of the torsion, which `D` replaces.
    pub(super) fn own_damping(&self, torsion_velocity: f64) -> f64 {
        match self.drive {
            DriveLoop::Position { damping, .. } => damping * torsion_velocity,
            DriveLoop::Current { .. } => 0.0,
        }
    }

    /// Further lead that brings a position-commanded drive through its dead zone, rad.
    #[must_use]
    pub fn dead_zone_inverse(&self, lead: f64) -> f64 {
        match self.drive {
            DriveLoop::Position { dead_zone, .. } if dead_zone > 0.0 => {
                dead_zone * smooth_sign(lead / (0.25 * dead_zone))
            }
            _ => 0.0,
        }
    }
}

/// The sign of `x`, made continuous from -3 to 3: the Padé approximant of tanh, which ends there with slope 0. A call
/// of tanh for each of thirty joints is 3 % of a cycle.
fn smooth_sign(x: f64) -> f64 {
    let x = x.clamp(-3.0, 3.0);
    x * (27.0 + x * x) / (27.0 + 9.0 * x * x)
}

#[cfg(test)]
impl LawParameters {
    /// For tests: a joint of 37 N·m whose drive takes positions.
    pub(super) fn example() -> Self {
        Self {
            sample_period: 1e-3,
            delay: 1.4e-3,
            drive: DriveLoop::Position {
                stiffness: 8000.0,
                damping: 58.0,
                dead_zone: 0.0,
                integral: 0.0,
            },
            rotor_inertia: 0.114,
            gear: GearStiffness::constant(9000.0),
            friction: FrictionModel::NONE,
            torque_limit: 37.0,
            disturbance_limit: 10.0,
            design: Design::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smooth_sign_is_odd_rises_and_ends_at_one() {
        let mut last = -1.0;
        for k in -400..=400 {
            let x = f64::from(k) * 0.01;
            let y = smooth_sign(x);
            assert_eq!(y, -smooth_sign(-x));
            assert!(
                y >= last && y.abs() <= 1.0 && (y - x.tanh()).abs() < 0.024,
                "{x}: {y}"
            );
            last = y;
        }
        assert_eq!([smooth_sign(3.0), smooth_sign(f64::INFINITY)], [1.0; 2]);
        assert!((smooth_sign(1e-6) - 1e-6).abs() < 1e-15);
    }

    /// Flexspline and wave generator in series, and one of them rigid.
    #[test]
    fn compliances_of_the_gear_add_up() {
        let gear = GearStiffness {
            k_fs0: 9000.0,
            c_fs: 0.02,
            k_wg0: 20_000.0,
            c_wg: 0.01,
        };
        let fs = 9000.0 * (1.0 + 0.36);
        let wg = 20_000.0 * 0.3_f64.exp();
        let sum = 1.0 / fs + 1.0 / wg;
        for torque in [30.0, -30.0] {
            assert!((gear.at(torque) * sum - 1.0).abs() < 1e-12);
        }
        let rigid = GearStiffness {
            k_wg0: f64::INFINITY,
            ..gear
        };
        assert!((rigid.at(30.0) / fs - 1.0).abs() < 1e-12);
        assert_eq!(GearStiffness::constant(7000.0).at(1e9), 7000.0);
    }
}
