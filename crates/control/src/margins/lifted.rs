//! One period of the loop as matrices, by superposition of its simulated responses.

use super::{JointLoop, Load};
use crate::predictive::{DriveLoop, LawParameters, LinearLaw, TauD};
use nalgebra::DMatrix;
use std::array::from_fn;

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

/// One joint's loop simulated in N lanes, which differ by load and state.
struct Simulated<const N: usize> {
    laws: [LinearLaw; N],
    truth: LawParameters,
    outer: TauD,
    torque_gain: f64,
    gear: f64,
    gear_damping: f64,
    inverse_rotor_inertia: f64,
    /// Spring on the rotor, N·m/rad.
    stick: [f64; N],
    /// Link: inverse inertia, spring, damper.
    link: [[f64; N]; 3],
    /// Steps of the drive's lag, and from a sample until its command reaches the drive.
    lag: usize,
    transport: usize,
    /// The command that is at the drive in each step: so many periods ago it left.
    late: [usize; SUBSTEPS],
    /// What the drive's filter of the velocity takes over in a step.
    smoothing: f64,
    /// Torque that the drive makes over the one that it should.
    gain: f64,
    h: f64,
}

/// State of the loops besides their laws'.
#[derive(Debug, Clone)]
struct State<const N: usize> {
    mechanical: [[f64; N]; MECHANICAL],
    /// The integral of the drive's velocity loop.
    integral: [f64; N],
    /// Torque that the drive made last.
    made: [f64; N],
    /// Torques in the drive's lag, a ring, and the place of the oldest.
    lag: Vec<[f64; N]>,
    oldest: usize,
    /// Commands on their way, the newest first.
    sent: Vec<[f64; N]>,
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
        let mut simulated = Simulated::new(&linear, [load]);
        let n = simulated.size();
        let unit = |i: usize, size: usize| {
            let mut x = vec![0.0; size];
            if let Some(x) = x.get_mut(i) {
                *x = 1.0;
            }
            x
        };
        let (rest, nothing) = (vec![0.0; n], vec![0.0; SUBSTEPS]);
        let open = |s: &mut Simulated<1>, x: &[f64], u: &[f64]| s.period(x, Some(u), 0.0);
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

/// Whether the joint comes to rest in simulations in time with each of these loads, where the drive makes `gain` times
/// the torque that it should. It is judged by the velocity of the torsion: in the torsion itself a slow motion hides a
/// quick ringing that grows. The help for a hand is proportional to the state, as all else in the loop, so one size of
/// each beginning will do.
pub(super) fn comes_to_rest(joint: &JointLoop, loads: [Load; 4], gain: f64) -> bool {
    /// Every load with each beginning.
    const LANES: usize = 4 * BEGINNINGS.len();
    let beginning = |lane: usize| BEGINNINGS[lane % BEGINNINGS.len()];
    let load = |lane: usize| loads[lane / BEGINNINGS.len()];
    let mut simulated = Simulated::<LANES>::new(joint, from_fn(load));
    simulated.gain = gain;
    let mut state = simulated.at_rest();
    for (i, of_lanes) in state.mechanical.iter_mut().take(4).enumerate() {
        *of_lanes = from_fn(|lane| beginning(lane)[i]);
    }
    let fifth = (0.2 * SIMULATED / joint.law.sample_period) as usize;
    let mut largest = [[0.0_f64; LANES]; 5];
    for largest in &mut largest {
        for _ in 0..fifth {
            simulated.pass(&mut state, 0.0, |_, made| made);
            let [_, omega, _, dq, _] = state.mechanical;
            *largest = from_fn(|l| largest[l].max((omega[l] - dq[l]).abs()));
        }
    }
    (0..LANES).all(|lane| {
        let of_lane = largest.map(|largest| largest[lane]);
        let least = of_lane[1..4].iter().copied().fold(f64::INFINITY, f64::min);
        of_lane[4] <= COMES_TO_REST * least
    })
}

impl<const N: usize> Simulated<N> {
    fn new(joint: &JointLoop, loads: [Load; N]) -> Self {
        let h = joint.law.sample_period / SUBSTEPS as f64;
        let gear = joint.truth.gear.at(joint.torque);
        let steps = |time: f64| (time / h).round().max(0.0) as usize;
        let transport = steps(joint.truth.delay - joint.drive_lag);
        let link = loads.map(|load| match load {
            Load::Blocked | Load::Stuck => [0.0; 3],
            Load::Spring => [1.0 / joint.link_inertia, gear / 3.0, 1e-3 * gear / 3.0],
            _ => [1.0 / (load.inertia_share() * joint.link_inertia), 0.0, 0.0],
        });
        let law = LinearLaw::new(&joint.law, joint.law.gear.at(joint.torque));
        // Differences over a period of the drive's loop, and their filter.
        let velocity_filter = 2.0 * joint.drive_lag;
        Self {
            laws: from_fn(|_| law.clone()),
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
            inverse_rotor_inertia: 1.0 / joint.truth.rotor_inertia,
            stick: loads.map(|load| match load {
                Load::Stuck => joint.stick(gear),
                _ => 0.0,
            }),
            link: [0, 1, 2].map(|i| link.map(|of_lane| of_lane[i])),
            lag: steps(joint.drive_lag),
            transport,
            late: from_fn(|step| transport.saturating_sub(step).div_ceil(SUBSTEPS)),
            smoothing: h / (h + velocity_filter),
            gain: 1.0,
            h,
        }
    }

    /// Commands that may act within a period.
    fn commands(&self) -> usize {
        self.transport.div_ceil(SUBSTEPS) + 1
    }

    /// The loops and their laws at rest.
    fn at_rest(&mut self) -> State<N> {
        self.laws.iter_mut().for_each(|law| law.set_state(&[]));
        State {
            mechanical: [[0.0; N]; MECHANICAL],
            integral: [0.0; N],
            made: [0.0; N],
            lag: vec![[0.0; N]; self.lag],
            oldest: 0,
            sent: vec![[0.0; N]; self.commands()],
        }
    }

    /// Lets a period pass. `drives`: the torque that drives the rotor in a step, by the one that the drive makes.
    fn pass(
        &mut self,
        state: &mut State<N>,
        tau_d: f64,
        drives: impl FnMut(usize, [f64; N]) -> [f64; N],
    ) {
        for lane in 0..N {
            if self.link[0][lane] == 0.0 {
                // Blocked.
                (state.mechanical[2][lane], state.mechanical[3][lane]) = (0.0, 0.0);
            }
        }
        let desired = TauD {
            torque: tau_d,
            ..self.outer
        };
        state.sent.rotate_right(1);
        let [theta, _, q, _, _] = state.mechanical;
        for (lane, law) in self.laws.iter_mut().enumerate() {
            let (theta, q) = (theta[lane], q[lane]);
            let measured = self.torque_gain * self.gear * (theta - q);
            state.sent[0][lane] = law.step((theta, q), [measured, state.made[lane]], desired);
        }
        // The drive's kind is decided outside of the steps.
        match self.truth.drive {
            DriveLoop::Position {
                stiffness, damping, ..
            } => self.steps(state, drives, |command, theta, omega| {
                stiffness * (command - theta) - damping * omega
            }),
            DriveLoop::Current {
                torque_constant,
                viscous,
            } => self.steps(state, drives, |command, _, omega| {
                torque_constant * command - viscous * omega
            }),
        }
    }

    /// All steps of a period. `makes`: a drive's torque by its command, theta and filtered omega.
    fn steps(
        &self,
        state: &mut State<N>,
        mut drives: impl FnMut(usize, [f64; N]) -> [f64; N],
        makes: impl Fn(f64, f64, f64) -> f64,
    ) {
        let h = self.h;
        let [mut theta, mut omega, mut q, mut dq, mut filtered] = state.mechanical;
        let integral_gain = h * self.truth.drive_integral();
        let [inverse_inertia, spring, damper] = self.link;
        for (step, &late) in self.late.iter().enumerate() {
            // The newest command that has arrived: sent[k] left k periods ago.
            let command = state.sent[late];
            filtered = from_fn(|l| filtered[l] + (omega[l] - filtered[l]) * self.smoothing);
            let loop_made: [f64; N] = from_fn(|l| makes(command[l], theta[l], filtered[l]));
            state.integral = from_fn(|l| state.integral[l] + integral_gain * loop_made[l]);
            let drive = from_fn(|l| self.gain * (loop_made[l] + state.integral[l]));
            // The oldest of the lag leaves as the newest comes.
            state.made = match state.lag.get_mut(state.oldest) {
                Some(oldest) => std::mem::replace(oldest, drive),
                None => drive,
            };
            state.oldest += 1;
            if state.oldest >= self.lag {
                state.oldest = 0;
            }
            let motor = drives(step, state.made);
            for l in 0..N {
                // Semi-implicit: the gear at the step's end.
                let torsion = theta[l] + h * omega[l] - q[l] - h * dq[l];
                let torque = self.gear * torsion + self.gear_damping * (omega[l] - dq[l]);
                let alpha =
                    (motor[l] - torque - self.stick[l] * theta[l]) * self.inverse_rotor_inertia;
                let of_link = torque - spring[l] * q[l] - damper[l] * dq[l];
                omega[l] += h * alpha;
                theta[l] += h * omega[l];
                dq[l] += h * inverse_inertia[l] * of_link;
                q[l] += h * dq[l];
            }
        }
        state.mechanical = [theta, omega, q, dq, filtered];
    }
}

impl Simulated<1> {
    /// States of the drive's integral.
    fn integral_states(&self) -> usize {
        if self.truth.drive_integral() > 0.0 || self.laws[0].integrates() {
            OF_INTEGRAL
        } else {
            0
        }
    }

    fn size(&self) -> usize {
        let law = self.laws[0].size();
        MECHANICAL + self.integral_states() + self.lag + self.commands() + law
    }

    /// A period from the state `x`: the next state, and the drive's torque in each step. The rotor is
    /// driven by `driven`, or by the drive.
    fn period(&mut self, x: &[f64], driven: Option<&[f64]>, tau_d: f64) -> (Vec<f64>, Vec<f64>) {
        let mut state = self.at_rest();
        let (mechanical, rest) = x.split_at(MECHANICAL);
        let (of_integral, rest) = rest.split_at(self.integral_states());
        let (lag, rest) = rest.split_at(self.lag);
        let (sent, law) = rest.split_at(self.commands());
        let set = |to: &mut [[f64; 1]], from: &[f64]| {
            to.iter_mut().zip(from).for_each(|(to, &from)| *to = [from]);
        };
        set(&mut state.mechanical, mechanical);
        set(&mut state.lag, lag);
        set(&mut state.sent, sent);
        if let &[integral, made] = of_integral {
            (state.integral, state.made) = ([integral], [made]);
        }
        self.laws[0].set_state(law);
        let mut torques = vec![0.0; SUBSTEPS];
        self.pass(&mut state, tau_d, |step, made| {
            torques[step] = made[0];
            driven.map_or(made, |driven| [driven[step]])
        });
        state.lag.rotate_left(state.oldest);
        let of_integral = [state.integral, state.made];
        let next = (state.mechanical.into_iter())
            .chain(of_integral.into_iter().take(self.integral_states()))
            .chain(state.lag)
            .chain(state.sent)
            .flatten();
        (next.chain(self.laws[0].state()).collect(), torques)
    }
}
