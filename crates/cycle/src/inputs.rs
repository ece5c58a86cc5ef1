//! Inputs of later stages: what clients send, and what the stages before have found out.

use dynamics::Motion;
use robot_config::TorqueLaw;
use robot_state::{
    CommandedRecord, CommanderRecord, EstimatedRecord, MAX_FT_SENSORS, MeasuredRecord, Reference,
    Settings, Wrench,
};
use supervisor::OperatorRequest;

use crate::estimate::{FastTorque, Loads};
use crate::judge::Soundness;

/// Clients' input to one cycle, as it arrived: unchecked.
#[derive(Debug, Clone, Copy, Default)]
pub struct ClientInput<'a> {
    /// The newest reference of the client that has the lease of the command, if one has it.
    pub reference: Option<&'a Reference>,
    /// Age of that reference, s.
    pub age_s: f64,
    /// The lease; the cycle fills in what it does with the reference.
    pub commander: CommanderRecord,
    /// The settings in use; none: those of the configuration.
    pub settings: Option<&'a Settings>,
    /// An operator's request, in the one cycle that is to carry it out.
    pub request: Option<OperatorRequest>,
}

/// What deciding goes by: the judgement of this cycle, and the commands of the last one.
#[derive(Debug)]
pub(crate) struct Known<'a> {
    pub(crate) soundness: &'a Soundness,
    pub(crate) measured: &'a MeasuredRecord,
    pub(crate) commanded: &'a CommandedRecord,
}

/// What modes and laws see of the robot in one cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub(crate) measured: &'a MeasuredRecord,
    pub(crate) estimated: &'a EstimatedRecord,
    /// Torques without delay, one for each joint.
    pub(crate) fast: &'a [FastTorque],
    /// Twist and proper acceleration of the root.
    pub(crate) base_motion: (Motion, Motion),
    /// What loads the robot besides its own mass, of some time before.
    pub(crate) loads: &'a Loads,
    /// Velocity of each link by its law's observer, of the last cycle, rad/s; none where there is no observer.
    pub(crate) observed: &'a [Option<f64>],
    /// The client's newest reference, unchecked: frames that it uses are shown in any mode.
    pub(crate) client: Option<&'a Reference>,
    /// Age of the reference, s.
    pub(crate) age_s: f64,
    pub(crate) torque_law: TorqueLaw,
    /// Sample period, s.
    pub(crate) dt: f64,
}

impl Seen<'_> {
    /// The contact wrenches as the F/T sensors show them.
    pub(crate) fn contact_wrenches(&self) -> [Wrench; MAX_FT_SENSORS] {
        std::array::from_fn(|s| self.estimated.ft[s].contact_wrench)
    }

    /// Velocity of a joint's link, rad/s: the observer, where there is one, is younger than the filter.
    pub(crate) fn velocity(&self, joint: usize) -> f64 {
        let measured = self.measured.joints.get(joint).map_or(0.0, |m| m.dq);
        self.observed
            .get(joint)
            .copied()
            .flatten()
            .unwrap_or(measured)
    }

    /// The torque that the predictive law feeds back, N·m.
    pub(crate) fn fast_torque(&self, joint: usize) -> Option<f64> {
        let estimated = self.estimated.joints.get(joint)?;
        self.fast.get(joint)?.fed_back(self.torque_law, estimated)
    }
}
