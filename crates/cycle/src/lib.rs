//! The 1 kHz computation: frames in, frames and a record out, one file per stage.
//!
//! The same function runs in the daemon, in tests and in replay: `now` is an argument, nothing
//! allocates after construction, and the same frames give the same bytes.
#![deny(unsafe_code)]

mod align;
mod command;
mod cross_check;
mod decide;
mod emit;
mod estimate;
mod events;
mod external;
mod filtered;
mod ft_offset;
mod limit;
mod measure;
mod predict;
mod usable;

use can_codec::Frames;
use core::fmt;
use estimators::filter_bank::FilterError;
use identification::FitError;
use robot_config::Robot;
use robot_state::{CycleRecord, Event, MAX_FT_SENSORS, MAX_JOINTS};
use whole_body::WholeBodyError;

use command::Command;
use emit::Emit;
use estimate::Estimate;
use events::Counts;
use measure::Measure;

use decide::Supervisor;
pub use decide::Wanted;

/// An instant, ns on the caller's clock. Only differences matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Stamp(pub u64);

/// The instants of one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Instants {
    /// SYNC went out: what hears it sampled then.
    pub sync: Stamp,
    /// The answers are in: now.
    pub now: Stamp,
}

/// The computation of one robot, with everything that it remembers from cycle to cycle.
#[derive(Debug)]
pub struct Cycle {
    measure: Measure,
    estimate: Estimate,
    supervisor: Supervisor,
    command: Command,
    emit: Emit,
    counts: Counts,
    record: CycleRecord,
}

impl Cycle {
    /// Prepares everything; the only place that allocates.
    ///
    /// # Errors
    /// A robot too large for the records, a filter or a set of sensors that cannot be used.
    pub fn new(robot: &Robot) -> Result<Self, CycleError> {
        let parameters = &robot.parameters;
        let (joints, sensors) = (parameters.joints.len(), parameters.ft_sensors.len());
        if joints > MAX_JOINTS || sensors > MAX_FT_SENSORS {
            return Err(CycleError::TooLarge { joints, sensors });
        }
        let record = CycleRecord {
            joint_count: joints as u32,
            ft_count: sensors as u32,
            ..CycleRecord::default()
        };
        Ok(Self {
            measure: Measure::new(robot)?,
            estimate: Estimate::new(robot)?,
            supervisor: Supervisor::new(joints, parameters.timing.reference_timeout),
            command: Command::new(robot),
            emit: Emit::new(robot),
            counts: Counts::new(),
            record,
        })
    }

    /// One cycle: what the frames say, what the torques are, what is wanted, what is commanded.
    pub fn step(
        &mut self,
        at: Instants,
        rx: &Frames,
        wanted: &Wanted<'_>,
        tx: &mut Frames,
    ) -> &CycleRecord {
        let (record, counts) = (&mut self.record, &mut self.counts);
        record.sequence += 1;
        record.stamp_ns = at.now.0;

        let readiness = (self.measure).update(at, rx, wanted.settings, record, counts);
        (self.estimate).update(&self.measure, wanted.settings, record, counts);
        let reference = self.supervisor.decide(wanted, readiness, counts);
        let mode = self.supervisor.mode();
        self.command.update(mode, reference, &self.estimate, record);
        if let Err(event) = self.command.limit(record, counts) {
            self.supervisor.report(event, counts);
        }
        self.emit.update(&self.command, readiness.seen, tx, counts);

        record.mode = self.supervisor.mode();
        record.fault = self.supervisor.fault_number();
        record.events = counts.as_array();
        record
    }

    /// Counts an event that the loop around the cycle has seen: bus errors, late cycles.
    pub fn note(&mut self, event: Event, times: u64) {
        self.counts.add_many(event, times);
    }

    /// The last record.
    #[must_use]
    pub fn record(&self) -> &CycleRecord {
        &self.record
    }
}

/// Why a cycle cannot be prepared.
#[derive(Debug)]
pub enum CycleError {
    /// More joints or F/T sensors than a record holds.
    TooLarge {
        /// Joints of the robot.
        joints: usize,
        /// F/T sensors of the robot.
        sensors: usize,
    },
    /// A filter that cannot be built.
    Filter(FilterError),
    /// Sensors from which the torques do not follow.
    WholeBody(WholeBodyError),
    /// A joint file whose estimators cannot be built.
    Calibration(FitError),
    /// A floating base without an IMU or a stand.
    NoImu,
}

impl fmt::Display for CycleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLarge { joints, sensors } => write!(
                f,
                "{joints} joints and {sensors} F/T sensors; \
                 allowed: at most {MAX_JOINTS} and {MAX_FT_SENSORS}"
            ),
            Self::Filter(error) => write!(f, "filters: {error}"),
            Self::WholeBody(error) => write!(f, "whole_body: {error}"),
            Self::Calibration(error) => write!(f, "calibration: {error}"),
            Self::NoImu => write!(f, "a floating base needs an IMU, or a stand"),
        }
    }
}

impl core::error::Error for CycleError {}

impl From<FilterError> for CycleError {
    fn from(error: FilterError) -> Self {
        Self::Filter(error)
    }
}

impl From<WholeBodyError> for CycleError {
    fn from(error: WholeBodyError) -> Self {
        Self::WholeBody(error)
    }
}
