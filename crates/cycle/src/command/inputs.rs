//! Inputs of deciding: what clients send, and what the stages before have found out.

use robot_state::{CommandedRecord, CommanderRecord, MeasuredRecord, Reference, Settings};
use supervisor::OperatorRequest;

use crate::estimate::Estimate;
use crate::measure::Readiness;

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

/// What the stages before have found out, and the commands of the last cycle.
#[derive(Debug)]
pub(crate) struct Known<'a> {
    pub(crate) readiness: &'a Readiness<'a>,
    pub(crate) measured: &'a MeasuredRecord,
    pub(crate) commanded: &'a CommandedRecord,
    pub(crate) estimate: &'a Estimate,
}
