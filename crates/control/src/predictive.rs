//! The predictive torque law: state feedback on the torque that will act when the command does.
//!
//! Rotor on the link side (`J = J_m N²`), gear stiffness `k`, torque `T` of the gear, drive with
//! stiffness `k_d` and damping `d_d` (zero where it takes currents):
//!
//! ```text
//! J omega' = m - d_d omega - T + d        m = k_d (u - theta)  or  m = K_t i
//! T'       = k (omega - dq)
//! ```
//!
//! A drive whose velocity loop integrates (P-PI) adds `z` to `m`, its integral. It shows in the motor's current alone:
//! `z' = (m - z) / T_i`, as it integrates what the loop makes besides it. So no error of angles or delay winds the
//! estimate up, an offset of the current acts as any other disturbance, and the inverse takes `z` off what it asks for.
//!
//! Friction that the desired motion of the rotor foresees is a known torque beside `m`.
//! `theta`, `omega` and the disturbance `d` (the rest of friction, model errors) come from one observer, `q`,
//! `dq` and `ddq` from another; both run ahead, with the commands that are on their way, to the
//! instant at which this command acts. There `m` is chosen such that the torque follows a model of
//! second order, and the drive's relation is inverted; a hand that moves the link is helped as far as the torque
//! shows it (`back_drive_assist`). What the limits make of the command returns
//! through [`PredictiveLaw::sent`]: the observer does not wind up against a limit, and a change of
//! mode has no bump. `docs/control.md` derives the gains.

mod ahead;
mod back_drive_assist;
mod drive;
mod drive_fit;
mod friction;
mod linear;
mod observers;
mod parameters;
mod reference;

pub use friction::{FrictionModel, Turned};
pub use parameters::{Contributions, Design, DriveLoop, GearStiffness, LawParameters, TorqueTerms};

pub(crate) use linear::{LinearLaw, TauD};

use back_drive_assist::{BackDriveAssist, least};
use drive::Steps;
use drive_fit::DriveFit;
use observers::{Link, Rotor, Uncertainty};
use reference::{ReferenceModel, ReferenceState};

/// Measured values of one joint in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensed {
    /// theta/N: motor-side angle on the link side, rad.
    pub theta: f64,
    /// q: link-side angle, rad.
    pub q: f64,
    /// T: torque that the gear carries, N·m; none: it follows from the last one and the torsion.
    pub torque: Option<f64>,
    /// K_t N i: torque of the motor's current, N·m; none: the drive reports none.
    pub motor_torque: Option<f64>,
    /// The angles were sampled in this cycle; otherwise both observers run on without them.
    pub fresh: bool,
}

/// The law of one joint, with its observers.
#[derive(Debug, Clone)]
pub struct PredictiveLaw {
    parameters: LawParameters,
    steps: Steps,
    rotor: Rotor,
    link: Link,
    /// Uncertainties of rotor and link observer after a gap.
    uncertainties: [Uncertainty; 2],
    /// T: torque of the newest sample, N·m.
    torque: f64,
    /// k: stiffness of the gear at that torque, N·m/rad.
    stiffness: f64,
    /// q of the newest sample, rad.
    measured_q: f64,
    reference_model: ReferenceModel,
    reference: [ReferenceState; 4],
    /// Velocity of the link below `Design::follow`, rad/s.
    slow_velocity: f64,
    follow_share: f64,
    /// Quicker estimates of both, by which a hand is helped; none where nothing helps.
    back_drive_assist: Option<BackDriveAssist>,
    /// Desired position, rad, and velocity through a low-pass of the reference model's bandwidth, rad/s; none before a
    /// mode's first.
    desired: Option<[f64; 2]>,
    desired_share: f64,
    /// Friction foreseen for the next command, N·m.
    friction: f64,
    /// z: torque of the integral in the drive's velocity loop, N·m, and its share that is new in a period.
    integral: f64,
    integral_share: f64,
    /// The drive's stiffness and damping by its currents; none for one that takes currents.
    drive_fit: Option<DriveFit>,
    /// Command that acted before the oldest of `commands`.
    before: Sent,
    /// Commands on their way, oldest first.
    commands: Vec<Sent>,
    started: bool,
}

/// Torques that act on the rotor for a period.
#[derive(Debug, Clone, Copy, Default)]
struct Sent {
    /// rad or A.
    command: f64,
    /// Friction foreseen for that time, N·m.
    friction: f64,
}

impl PredictiveLaw {
    /// The law before the first sample; the only place that allocates.
    #[must_use]
    pub fn new(parameters: LawParameters) -> Self {
        let p = &parameters;
        let (cycles, _) = p.delay_in_cycles();
        let dt = p.sample_period;
        Self {
            steps: Steps::new(p),
            rotor: Rotor::new(p),
            link: Link::new(p),
            uncertainties: [Rotor::uncertainty(p), Link::uncertainty(p)],
            torque: 0.0,
            stiffness: parameters.gear.at(0.0),
            measured_q: 0.0,
            reference_model: ReferenceModel::new(p.design.reference, dt),
            reference: [ReferenceState::default(); 4],
            slow_velocity: 0.0,
            follow_share: 1.0 - (-p.design.follow * dt).exp(),
            back_drive_assist: BackDriveAssist::new(p),
            desired: None,
            desired_share: 1.0 - (-p.design.reference * dt).exp(),
            friction: 0.0,
            integral: 0.0,
            integral_share: 1.0 - (-p.drive_integral() * dt).exp(),
            drive_fit: DriveFit::new(p),
            before: Sent::default(),
            commands: vec![Sent::default(); cycles + 1],
            started: false,
            parameters,
        }
    }

    /// Parameters of the law.
    #[must_use]
    pub fn parameters(&self) -> &LawParameters {
        &self.parameters
    }

    /// Forgets every sample and command.
    pub fn reset(&mut self) {
        self.started = false;
    }

    /// T: the newest torque fed back, N·m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.torque
    }

    /// dq: velocity of the link by the observer, rad/s.
    #[must_use]
    pub fn link_velocity(&self) -> f64 {
        self.link.velocity()
    }

    /// dq and omega: velocities of link and rotor, on the link side, rad/s, for some time after a gap
    /// ([`Self::sleep`]): filters still hold the gap.
    #[must_use]
    pub fn velocities_after_gap(&self) -> Option<[f64; 2]> {
        let settling = self.uncertainties.iter().any(Uncertainty::is_settling);
        settling.then(|| [self.link.velocity(), self.rotor.omega])
    }

    /// omega: velocity of the rotor, link side, rad/s; none before the first sample.
    #[must_use]
    pub fn rotor_velocity(&self) -> Option<f64> {
        self.started.then_some(self.rotor.omega)
    }

    /// d: torque on the rotor that the drive's model does not explain, N·m.
    #[must_use]
    pub fn disturbance(&self) -> f64 {
        self.rotor.disturbance
    }

    /// Takes a sample; in every cycle and every mode, before `command`.
    pub fn observe(&mut self, sensed: &Sensed) {
        let measurable = sensed.theta.is_finite() && sensed.q.is_finite();
        let torque = sensed.torque.filter(|torque| torque.is_finite());
        if !self.started || !self.is_finite() {
            if measurable {
                self.start(sensed.theta, sensed.q, torque.unwrap_or(0.0));
                let made = sensed.motor_torque.filter(|m| m.is_finite());
                if self.integral_share > 0.0 {
                    self.integral = made.unwrap_or(self.torque);
                }
            }
            return;
        }
        let integral = self.integral;
        self.advance(torque);
        if let Some(made) = sensed
            .motor_torque
            .filter(|m| sensed.fresh && m.is_finite())
        {
            self.integral = integral + self.integral_share * (made - integral);
        }
        if sensed.fresh && measurable {
            let limit = self.parameters.disturbance_limit;
            let [rotor, link] = &mut self.uncertainties;
            self.rotor.correct(sensed.theta, limit, rotor.gain());
            self.link.correct(sensed.q, link.gain());
            if let Some(assist) = &mut self.back_drive_assist {
                assist.correct(sensed.q);
            }
            self.measured_q = sensed.q;
        }
        // The slow velocity follows in every mode: the next one must not begin with the velocity at which the last one
        // ended.
        self.slow_velocity += self.follow_share * (self.link.velocity() - self.slow_velocity);
        let settles = self.uncertainties.iter().any(Uncertainty::is_settling);
        match &mut self.back_drive_assist {
            // The assist's gains are those of a joint that has been observed all the time.
            Some(assist) if settles => assist.join(&self.link, self.slow_velocity),
            Some(assist) => assist.follow(),
            None => {}
        }
        self.fit_drive(sensed);
    }

    /// A period in which the loop did not run: no sample was taken, and the drive kept its command.
    /// Before the sample that follows it.
    pub fn skip(&mut self) {
        if !self.started {
            return;
        }
        self.advance(None);
        if let Some(fit) = &mut self.drive_fit {
            fit.interrupt();
        }
        let kept = self.commands.last().copied().unwrap_or(self.before);
        self.sent(kept.command);
    }

    /// A period of a gap that is so long that the drive has braked the joint: its velocity is not known any more.
    pub fn sleep(&mut self) {
        self.skip();
        self.uncertainties.iter_mut().for_each(Uncertainty::sleep);
    }

    /// After the first sample that follows such a gap: the law goes on from the torque and the rotor's velocity that
    /// the drive has led to. Returns that torque, N·m.
    pub fn go_on(&mut self) -> f64 {
        // Motion that the drive's damping goes along with: a filter of its own, that remembers the motion before.
        self.slow_velocity = self.rotor.omega;
        if let Some(assist) = &mut self.back_drive_assist {
            assist.join(&self.link, self.slow_velocity);
        }
        self.hold_reference()
    }

    /// Both observers run on by a period; `torque`: T at its end, N·m, or none where it was not
    /// measured.
    fn advance(&mut self, torque: Option<f64>) {
        let last_torque = self.torque;
        // The torque that the last one and the model lead to, where none was measured.
        let predicted = last_torque
            + self.stiffness
                * self.parameters.sample_period
                * (self.rotor.omega - self.link.velocity());
        let torque = torque.unwrap_or(predicted);
        let mean = 0.5 * (torque + last_torque);
        let acted = self.commands.first().copied().unwrap_or(self.before);
        let p = &self.parameters;
        for (step, sent) in [(&self.steps.lag, self.before), (&self.steps.rest, acted)] {
            let made = p.motor_torque(sent.command, self.rotor.theta) + self.integral;
            self.rotor.advance(step, made - sent.friction - mean);
            let acted = (sent.command, step.time);
            self.integral = p.wound_up(self.integral, acted, [self.rotor.theta, self.rotor.omega]);
        }
        self.link.advance();
        if let Some(assist) = &mut self.back_drive_assist {
            assist.advance();
        }
        self.set_torque(torque);
    }

    fn set_torque(&mut self, torque: f64) {
        (self.torque, self.stiffness) = (torque, self.parameters.gear.at(torque));
    }

    /// The joint stands, and its drive carries what it carries.
    fn start(&mut self, theta: f64, q: f64, torque: f64) {
        if let Some(fit) = &mut self.drive_fit {
            fit.interrupt();
        }
        self.rotor.start(theta);
        self.link.start(q);
        if let Some(assist) = &mut self.back_drive_assist {
            assist.start(q);
        }
        self.measured_q = q;
        self.set_torque(torque);
        self.slow_velocity = 0.0;
        let command = self.parameters.command_for(torque, theta);
        (self.friction, self.integral) = (0.0, 0.0);
        self.before = Sent {
            command,
            friction: 0.0,
        };
        self.commands.fill(self.before);
        let _ = self.hold_reference();
        self.started = true;
    }

    /// The reference model begins at the torque of this instant, which it returns, N·m: before the
    /// first `command` of a mode.
    pub fn hold_reference(&mut self) -> f64 {
        self.reference = [ReferenceState::default(); 4];
        self.reference[0].value = self.torque;
        self.desired = None;
        self.torque
    }

    /// The motion that is desired for this command, rad and rad/s: the drive's damping goes along with changes of its
    /// velocity at once, not behind the filter of the measured one. A feed-forward, that leaves margins as they are.
    /// Only what velocity and positions agree on counts: one that its positions do not make would push the joint.
    /// `share`: part of the motion that the joint is going to make.
    pub fn desire_motion(&mut self, [q_d, dq_d]: [f64; 2], share: f64) {
        let [last_q, last] = self.desired.unwrap_or([q_d, share * dq_d]);
        let made = match self.desired {
            Some(_) => (q_d - last_q) / self.parameters.sample_period,
            None => dq_d,
        };
        let agreed = if made * dq_d > 0.0 {
            made.abs().min(dq_d.abs()).copysign(dq_d)
        } else {
            0.0
        };
        let next = last + self.desired_share * (share * agreed - last);
        self.slow_velocity += next - last;
        if let Some(assist) = &mut self.back_drive_assist {
            assist.lead(next - last);
        }
        self.desired = Some([q_d, next]);
    }

    /// The command for the desired torques' sum, rad or A, and its contributions.
    pub fn command(&mut self, desired: &TorqueTerms) -> Contributions {
        let ahead = self.ahead();
        let p = &self.parameters;
        let stiffness = self.stiffness;
        let (stiff, damping) = p.feedback(stiffness);
        let desired = desired.within(p.torque_limit);
        let last_torque = self.reference_torque();
        let last_feedforward = self.reference[0].value;
        for (state, wanted) in self.reference.iter_mut().zip(desired) {
            self.reference_model.advance(state, wanted);
        }
        let (model, inertia) = (&self.reference_model, p.rotor_inertia);
        let (per_torque, compliance) = (self.steps.per_torque, 1.0 / stiffness);
        let inputs = self.reference.iter().zip(desired);
        let mut shares = [0.0; 4];
        for (share, (state, wanted)) in shares.iter_mut().zip(inputs) {
            let curvature = model.curvature(state, wanted);
            // m = T + K/k (w - T) - D ((omega - dq) - w'/k) + J w''/k - d: the terms of w.
            let torque = stiff * state.value + damping * state.rate + inertia * curvature;
            *share = torque * compliance;
        }
        // The terms of the state.
        let feedback = (1.0 - stiff * compliance) * ahead.torque - damping * ahead.torsion_velocity;
        let follow = p.carried_damping(self.slow_velocity, ahead.omega);
        let drive = p.own_damping(ahead.torsion_velocity);
        let wound = self.reference_torque() - last_torque;
        let asked = self.reference[0].value - last_feedforward;
        let turned = self.turned(wound * compliance, asked * compliance);
        self.friction = p.friction.after(self.friction, &turned);
        let assist = self.back_drive_torque(ahead.torque, damping);
        let friction = follow + self.friction - self.rotor.disturbance + assist;
        let wanted: f64 = shares.iter().sum();
        let lead = per_torque * (wanted + feedback + drive + friction - ahead.integral);
        let zone = p.dead_zone_inverse(lead);
        let from = p.measured_origin(self.measured_q);
        let origin = p.measured_origin(ahead.theta);
        let [feedforward, position, velocity, force] = shares.map(|share| per_torque * share);
        Contributions {
            command: origin + lead + zone,
            desired: desired.iter().sum(),
            motor_torque: wanted + feedback,
            feedforward_torque: feedforward,
            feedforward_friction: per_torque * (friction - ahead.integral) + zone,
            feedback_position: position,
            feedback_velocity: velocity,
            feedback_force: force,
            feedback_torque: origin - from + per_torque * (feedback + drive),
            origin: from,
        }
    }

    /// Further torque of the motor for a hand that moves the link, N·m, as far as gear and rotor both show it.
    /// `torque`: T+, `damping`: D.
    fn back_drive_torque(&self, torque: f64, damping: f64) -> f64 {
        let Some(assist) = &self.back_drive_assist else {
            return 0.0;
        };
        let p = &self.parameters;
        let dampings = [damping, p.rotor_damping()];
        let further = assist.further_torque(&self.link, self.slow_velocity, dampings);
        let by_torsion = self.reference_torque() - torque;
        let by_rotor = by_torsion + self.rotor.disturbance;
        p.design.assist * least([further, by_torsion, by_rotor])
    }

    /// Way of the rotor in this period, by the change of the desired torsion and of the part of it that the
    /// feed-forward asks for, rad.
    fn turned(&self, torsion: f64, asked_torsion: f64) -> Turned {
        let dt = self.parameters.sample_period;
        let desired = self.desired.map_or(0.0, |[_, dq_d]| dq_d);
        let asked = asked_torsion + dt * desired;
        let turned = torsion + dt * self.link.velocity();
        Turned {
            asked,
            unasked: turned - asked,
            sliding: (turned * self.steps.per_sliding_way).clamp(-1.0, 1.0),
        }
    }

    /// w: torque of the reference model, N·m.
    fn reference_torque(&self) -> f64 {
        self.reference.iter().map(|state| state.value).sum()
    }

    /// The command sent after all limits, rad or A; after every cycle in which a command is sent.
    pub fn sent(&mut self, command: f64) {
        if !command.is_finite() {
            return;
        }
        let sent = Sent {
            command,
            friction: self.friction,
        };
        self.before = self.commands.first().copied().unwrap_or(sent);
        self.commands.rotate_left(1);
        if let Some(last) = self.commands.last_mut() {
            *last = sent;
        }
    }

    fn is_finite(&self) -> bool {
        self.rotor.is_finite()
            && self.link.is_finite()
            && self.torque.is_finite()
            && self.reference.iter().all(ReferenceState::is_finite)
            && self.slow_velocity.is_finite()
            && self
                .back_drive_assist
                .as_ref()
                .is_none_or(BackDriveAssist::is_finite)
            && self.friction.is_finite()
            && self.integral.is_finite()
    }
}
