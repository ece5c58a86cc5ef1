//! One period of the loop as matrices, by superposition of its simulated responses.

use super::{JointLoop, Load};
use crate::predictive::{DriveLoop, LawParameters, LinearLaw, TauD};
use nalgebra::DMatrix;

/// Steps of the plant in a period.
pub(super) const SUBSTEPS: usize = 40;

/// `x+ = A x + B u`, `y = C x + D u`: `u` the torque that drives the rotor in each step, `y` the torque
/// that the drive makes in each.
#[derive(Debug, Clone)]
pub(super) struct Lifted {
    pub(super) a: DMatrix<f64>,
    pub(super) b: DMatrix<f64>,
    pub(super) c: DMatrix<f64>,
    pub(super) d: DMatrix<f64>,
    /// Closed loop: `x+ = F x + g tau_d`, and the torque at the samples `h x`.
    pub(super) closed: DMatrix<f64>,
    pub(super) from_desired: DMatrix<f64>,
    pub(super) torque: DMatrix<f64>,
    pub(super) sample_period: f64,
}

/// The simulated loop.
struct Simulated {
    law: LinearLaw,
    truth: LawParameters,
    outer: TauD,
    torque_gain: f64,
    gear: f64,
    gear_damping: f64,
    /// Spring on the rotor, N·m/rad.
    stick: f64,
    /// Link: inverse inertia, spring, damper.
    link: [f64; 3],
    /// Steps of the drive's lag, and from a sample until its command reaches the drive.
    lag: usize,
    transport: usize,
    /// Time constant of the drive's velocity, s.
    velocity_filter: f64,
    /// Torque that the drive makes over the one that it should.
    gain: f64,
    h: f64,
}

/// theta, omega, q, dq, and omega as the drive filters it.
const MECHANICAL: usize = 5;
/// Number of further states of a drive whose velocity loop integrates: the integral, and the torque made last.
const OF_INTEGRAL: usize = 2;

impl Lifted {
    pub(super) fn new(joint: &JointLoop, load: Load) -> Self {
        // What depends on evidence is not linear.
        let mut linear = *joint;
        linear.law.design.assist = 0.0;
        let mut simulated = Simulated::new(&linear, load);
        let n = simulated.size();
        let unit = |i: usize, size: usize| {
            let mut x = vec![0.0; size];
            if let Some(x) = x.get_mut(i) {
                *x = 1.0;
            }
            x
        };
        let (rest, nothing) = (vec![0.0; n], vec![0.0; SUBSTEPS]);
        let open = |s: &mut Simulated, x: &[f64], u: &[f64]| s.period(x, Some(u), 0.0);
        let columns = |of: &mut dyn FnMut(usize) -> (Vec<f64>, Vec<f64>), count: usize| {
            let both: Vec<_> = (0..count).map(of).collect();
            (
                DMatrix::from_fn(n, count, |i, j| both[j].0[i]),
                DMatrix::from_fn(SUBSTEPS, count, |i, j| both[j].1[i]),
            )
        };
        let (a, c) = columns(&mut |j| open(&mut simulated, &unit(j, n), &nothing), n);
        let (b, d) = columns(
            &mut |j| open(&mut simulated, &rest, &unit(j, SUBSTEPS)),
            SUBSTEPS,
        );
        let (closed, _) = columns(&mut |j| simulated.period(&unit(j, n), None, 0.0), n);
        let (from_desired, _) = simulated.period(&rest, None, 1.0);
        let gear = simulated.gear;
        Self {
            a,
            b,
            c,
            d,
            closed,
            from_desired: DMatrix::from_vec(n, 1, from_desired),
            torque: DMatrix::from_fn(1, n, |_, i| match i {
                0 => gear,
                2 => -gear,
                _ => 0.0,
            }),
            sample_period: joint.law.sample_period,
        }
    }
}

/// Time that a loop is simulated for, s. Chosen; no experiment recorded.
const SIMULATED: f64 = 2.0;
/// Share of the last fifth of a simulation over the least of the three before up to which a loop counts as one that
/// comes to rest. A spring that nothing damps swings on. Chosen; no experiment recorded.
const COMES_TO_REST: f64 = 1.05;
/// Beginnings (theta, omega, q, dq): both angles and both velocities, each in its own direction; and a blow to the
/// rotor. The help for two motions at once is not the sum of the help for each: a slow one may keep a quick one from
/// having it. Their sizes do not matter, as the help is homogeneous.
const BEGINNINGS: [[f64; 4]; 2] = [[1e-3, -0.05, -5e-4, 0.1], [0.0, 0.05, 0.0, 0.0]];

/// Whether the joint comes to rest in simulations in time, where the drive makes `gain` times the torque that it
/// should. It is judged by the velocity of the torsion: in the torsion itself a slow motion hides a quick ringing that
/// grows. The help for a hand is proportional to the state, as all else in the loop, so one size of each beginning will
/// do.
pub(super) fn comes_to_rest(joint: &JointLoop, load: Load, gain: f64) -> bool {
    let mut simulated = Simulated::new(joint, load);
    simulated.gain = gain;
    let fifth = (0.2 * SIMULATED / joint.law.sample_period) as usize;
    BEGINNINGS.iter().all(|beginning| {
        let mut x = vec![0.0; simulated.size()];
        for (x, start) in x.iter_mut().zip(beginning) {
            *x = *start;
        }
        let mut largest = [0.0_f64; 5];
        for largest in &mut largest {
            for _ in 0..fifth {
                x = simulated.period(&x, None, 0.0).0;
                *largest = largest.max((x[1] - x[3]).abs());
            }
        }
        let least = largest[1..4].iter().copied().fold(f64::INFINITY, f64::min);
        largest[4] <= COMES_TO_REST * least
    })
}

impl Simulated {
    fn new(joint: &JointLoop, load: Load) -> Self {
        let h = joint.law.sample_period / SUBSTEPS as f64;
        let gear = joint.truth.gear.at(joint.torque);
        let steps = |time: f64| (time / h).round().max(0.0) as usize;
        let free = |share: f64| [1.0 / (share * joint.link_inertia), 0.0, 0.0];
        Self {
            law: LinearLaw::new(&joint.law, joint.law.gear.at(joint.torque)),
            truth: joint.truth,
            outer: TauD {
                torque: 0.0,
                stiffness: joint.stiffness,
                damping: joint.damping,
                load_follow: joint.load_follow,
            },
            torque_gain: joint.torque_gain,
            gear,
            gear_damping: 2.0 * joint.gear_damping * (gear * joint.truth.rotor_inertia).sqrt(),
            stick: match load {
                Load::Stuck => 2.0 * gear,
                _ => 0.0,
            },
            link: match load {
                Load::Blocked | Load::Stuck => [0.0; 3],
                Load::Free => free(1.0),
                Load::Light => free(0.2),
                Load::Heavy => free(5.0),
                Load::Spring => [1.0 / joint.link_inertia, gear / 3.0, 1e-3 * gear / 3.0],
            },
            lag: steps(joint.drive_lag),
            transport: steps(joint.truth.delay - joint.drive_lag),
            // Differences over a period of the drive's loop, and their filter.
            velocity_filter: 2.0 * joint.drive_lag,
            gain: 1.0,
            h,
        }
    }

    /// Commands that may act within a period.
    fn commands(&self) -> usize {
        self.transport.div_ceil(SUBSTEPS) + 1
    }

    /// States of the drive's integral.
    fn integral_states(&self) -> usize {
        if self.truth.drive_integral() > 0.0 || self.law.integrates() {
            OF_INTEGRAL
        } else {
            0
        }
    }

    fn size(&self) -> usize {
        MECHANICAL + self.integral_states() + self.lag + self.commands() + self.law.size()
    }

    /// A period from the state `x`: the next state, and the drive's torque in each step. The rotor is
    /// driven by `driven`, or by the drive.
    fn period(&mut self, x: &[f64], driven: Option<&[f64]>, tau_d: f64) -> (Vec<f64>, Vec<f64>) {
        let (mechanical, rest) = x.split_at(MECHANICAL);
        let (of_integral, rest) = rest.split_at(self.integral_states());
        let (on_the_way, rest) = rest.split_at(self.lag);
        let (sent, law) = rest.split_at(self.commands());
        let &[mut theta, mut omega, mut q, mut dq, mut filtered] = mechanical else {
            return (x.to_vec(), vec![0.0; SUBSTEPS]);
        };
        if self.link[0] == 0.0 {
            // Blocked.
            (q, dq) = (0.0, 0.0);
        }
        let (mut lag, mut sent) = (on_the_way.to_vec(), sent.to_vec());
        self.law.set_state(law);
        let [mut integral, mut made_last] = match *of_integral {
            [integral, last] => [integral, last],
            _ => [0.0; 2],
        };
        let measured = self.torque_gain * self.gear * (theta - q);
        let desired = TauD {
            torque: tau_d,
            ..self.outer
        };
        sent.rotate_right(1);
        sent[0] = self.law.step((theta, q), [measured, made_last], desired);

        let mut made = vec![0.0; SUBSTEPS];
        let h = self.h;
        for (step, made) in made.iter_mut().enumerate() {
            // The newest command that has arrived: sent[k] left k periods ago.
            let late = self.transport.saturating_sub(step).div_ceil(SUBSTEPS);
            filtered += (omega - filtered) * h / (h + self.velocity_filter);
            let loop_made = self.drive_torque(sent[late], theta, filtered);
            integral += h * self.truth.drive_integral() * loop_made;
            let drive = self.gain * (loop_made + integral);
            // The oldest of the lag leaves as the newest comes.
            *made = match step.checked_rem(self.lag) {
                Some(oldest) => std::mem::replace(&mut lag[oldest], drive),
                None => drive,
            };
            made_last = *made;
            let motor = driven.map_or(*made, |driven| driven[step]);
            let [inverse_inertia, spring, damper] = self.link;
            // Semi-implicit: the gear at the step's end.
            let torque =
                self.gear * (theta + h * omega - q - h * dq) + self.gear_damping * (omega - dq);
            let alpha = (motor - torque - self.stick * theta) / self.truth.rotor_inertia;
            let acceleration = inverse_inertia * (torque - spring * q - damper * dq);
            omega += h * alpha;
            theta += h * omega;
            dq += h * acceleration;
            q += h * dq;
        }
        lag.rotate_left(SUBSTEPS.checked_rem(self.lag).unwrap_or(0));
        let mechanical = [theta, omega, q, dq, filtered];
        let of_integral = [integral, made_last].into_iter().take(of_integral.len());
        let next = (mechanical.into_iter().chain(of_integral))
            .chain(lag)
            .chain(sent);
        (next.chain(self.law.state()).collect(), made)
    }

    fn drive_torque(&self, command: f64, theta: f64, omega: f64) -> f64 {
        match self.truth.drive {
            DriveLoop::Position {
                stiffness, damping, ..
            } => stiffness * (command - theta) - damping * omega,
            DriveLoop::Current {
                torque_constant,
                viscous,
            } => torque_constant * command - viscous * omega,
        }
    }
}
