//! The law as a linear system: its own code with states set and read, for margins.

use super::back_drive_assist::BackDriveAssist;
use super::friction::FrictionModel;
use super::parameters::{DriveLoop, GearStiffness, LawParameters, TorqueTerms};
use super::{PredictiveLaw, Sensed};
use crate::carried::CarriedTorque;

/// The law around one torque: constant stiffness of the gear, no dead zone, no limits. It is the
/// code of the law itself, so that the two cannot differ. Linear but for the help for a hand, which
/// grows as the state does: without it where the design has none.
#[derive(Debug, Clone)]
pub(crate) struct LinearLaw {
    law: PredictiveLaw,
    /// The carried torque that is fed back, N·m.
    carried: CarriedTorque,
}

impl LinearLaw {
    /// The law where the gear has this stiffness, N·m/rad.
    pub(crate) fn new(parameters: &LawParameters, stiffness: f64) -> Self {
        let mut drive = parameters.drive;
        if let DriveLoop::Position { dead_zone, .. } = &mut drive {
            *dead_zone = 0.0;
        }
        let mut law = PredictiveLaw::new(LawParameters {
            drive,
            gear: GearStiffness::constant(stiffness),
            friction: FrictionModel::NONE,
            torque_limit: f64::INFINITY,
            disturbance_limit: f64::INFINITY,
            ..*parameters
        });
        law.started = true;
        // The fit of the drive is left out: it is not linear.
        law.drive_fit = None;
        Self {
            law,
            carried: CarriedTorque::default(),
        }
    }

    /// Numbers that make up the state.
    pub(crate) fn size(&self) -> usize {
        self.others() + self.law.commands.len()
    }

    /// States besides the commands on their way.
    fn others(&self) -> usize {
        self.integral_at() + usize::from(self.integrates())
    }

    /// The place of the drive's integral, of one that has one.
    fn integral_at(&self) -> usize {
        FIXED
            + self
                .law
                .back_drive_assist
                .map_or(0, |_| BackDriveAssist::STATES)
    }

    /// The drive is known to integrate.
    pub(crate) fn integrates(&self) -> bool {
        self.law.integral_share > 0.0
    }

    pub(crate) fn set_state(&mut self, x: &[f64]) {
        let at = |i: usize| x.get(i).copied().unwrap_or(0.0);
        let (others, integral_at) = (self.others(), self.integral_at());
        let integrates = self.integrates();
        let law = &mut self.law;
        law.rotor.set_state([at(0), at(1), at(2)]);
        law.link.set_state([at(3), at(4), at(5)]);
        law.set_torque(at(6));
        (law.slow_velocity, law.before.command) = (at(7), at(8));
        (law.reference[0].value, law.reference[0].rate) = (at(9), at(10));
        for (i, sent) in law.commands.iter_mut().enumerate() {
            sent.command = at(others + i);
        }
        if let Some(assist) = &mut law.back_drive_assist {
            assist.set_state([0, 1, 2, 3].map(|i| at(FIXED + i)));
        }
        law.integral = if integrates { at(integral_at) } else { 0.0 };
        self.carried = CarriedTorque::with_state([at(11), at(12)]);
    }

    pub(crate) fn state(&self) -> impl Iterator<Item = f64> {
        let law = &self.law;
        let w = &law.reference[0];
        let before = law.before.command;
        let own = [law.torque, law.slow_velocity, before, w.value, w.rate];
        let angles = law.rotor.state().into_iter().chain(law.link.state());
        let commands = law.commands.iter().map(|sent| sent.command);
        let carried = self.carried.state();
        let assist = law
            .back_drive_assist
            .iter()
            .flat_map(BackDriveAssist::state);
        let integral = self.integrates().then_some(law.integral);
        let others = carried.into_iter().chain(assist).chain(integral);
        angles.chain(own).chain(others).chain(commands)
    }

    /// One cycle; the command is sent as it is. `made`: torque of the motor by its current, N·m.
    pub(crate) fn step(
        &mut self,
        (theta, q): (f64, f64),
        [torque, made]: [f64; 2],
        tau_d: TauD,
    ) -> f64 {
        self.law.observe(&Sensed {
            theta,
            q,
            torque: Some(torque),
            motor_torque: Some(made),
            fresh: true,
        });
        let TauD {
            torque: desired,
            stiffness,
            damping,
            load_follow,
        } = tau_d;
        let period = self.law.parameters.sample_period;
        let carried = if load_follow > 0.0 {
            self.carried.follow(torque, load_follow, period)
        } else {
            0.0
        };
        // The outer loop as the controller closes it: newest position, the observer's velocity.
        let feedforward = desired + carried - stiffness * q - damping * self.law.link_velocity();
        let command = self.law.command(&TorqueTerms {
            feedforward,
            ..TorqueTerms::default()
        });
        self.law.sent(command.command);
        command.command
    }
}

/// The desired torque: `torque - stiffness q - damping dq`, and the carried torque below `load_follow`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct TauD {
    pub(crate) torque: f64,
    pub(crate) stiffness: f64,
    pub(crate) damping: f64,
    /// Bandwidth in which the carried torque is fed back, rad/s; 0: it is not.
    pub(crate) load_follow: f64,
}

/// States besides the assist's and the commands on their way.
const FIXED: usize = 13;
