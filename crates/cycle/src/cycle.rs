//! One cycle of the loop.

use can_codec::Frames;
use robot_config::Robot;
use robot_state::{CycleRecord, Event, MAX_FT_SENSORS, MAX_JOINTS};

use crate::command::{Command, Emit, Supervisor, Wanted};
use crate::error::CycleError;
use crate::estimate::Estimate;
use crate::events::Counts;
use crate::measure::Measure;
use crate::time::Instants;

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
