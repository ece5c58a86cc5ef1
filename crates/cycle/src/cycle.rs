//! One cycle of the loop.

use can_codec::Frames;
use problem::Problem;
use robot_config::Robot;
use robot_state::{CycleRecord, Event, MAX_FT_SENSORS, MAX_JOINTS, Mode};

use crate::command::{ClientInput, Command, Emit, Input, Known, Supervisor};
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
    pub fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let (joints, sensors) = (parameters.joints.len(), parameters.ft_sensors.len());
        if joints > MAX_JOINTS || sensors > MAX_FT_SENSORS {
            return Err(Problem::new(
                format!("the robot has {joints} joints and {sensors} F/T sensors"),
                format!("at most {MAX_JOINTS} and {MAX_FT_SENSORS}"),
            ));
        }
        let record = CycleRecord {
            joint_count: joints as u32,
            ft_count: sensors as u32,
            ..CycleRecord::default()
        };
        Ok(Self {
            measure: Measure::new(robot).map_err(|problem| problem.of("[filters]"))?,
            estimate: Estimate::new(robot)?,
            supervisor: Supervisor::new(robot),
            command: Command::new(robot).map_err(|problem| problem.of("[filters]"))?,
            emit: Emit::new(robot),
            counts: Counts::new(),
            record,
        })
    }

    /// Starts with a fault that was latched before: no set-point leaves until an operator has
    /// acknowledged it.
    pub fn start_with_fault(&mut self, event: Event) {
        self.supervisor.start_with_fault(event);
    }

    /// One cycle: measure, estimate, decide, command, limit, emit.
    ///
    /// Each stage reads the groups of the record that stand before its own, and writes its own.
    pub fn step(
        &mut self,
        at: Instants,
        rx: &Frames,
        client: &ClientInput<'_>,
        tx: &mut Frames,
    ) -> &CycleRecord {
        let holds = self.record.mode == Mode::Hold.number();
        let CycleRecord {
            measured,
            estimated,
            commanded,
            ..
        } = &mut self.record;
        let counts = &mut self.counts;

        (self.measure).update(at, rx, client.settings, holds, measured, counts);
        let settings = client.settings;
        (self.estimate).update(
            &self.measure,
            (settings, !holds),
            measured,
            commanded,
            estimated,
            counts,
        );
        (self.estimate).contradict(measured, estimated, commanded, counts);
        let measure = &mut self.measure;
        (self.estimate).explain_torsions(measured, estimated, |j, torsion| {
            measure.explain_torsion(j, torsion);
        });
        let overslept = measure.readiness().overslept;
        (self.estimate).drifting(measured, estimated, commanded, overslept, |j| {
            measure.distrust(j);
        });
        let readiness = self.measure.readiness();
        let known = Known {
            readiness: &readiness,
            measured,
            commanded,
            estimate: &self.estimate,
        };
        let goal = self.supervisor.decide(client, &known, counts);
        let input = Input {
            measured,
            readiness: readiness.joints,
            estimated,
            fast: self.estimate.fast_torques(),
            base_motion: self.estimate.base_motion(),
            client: client.reference,
            age_s: client.age_s,
            skipped: self.measure.skipped(),
            overslept: readiness.overslept,
        };
        let engaged = |joint| self.supervisor.is_engaged(joint);
        (self.command).update(&goal, engaged, &input, commanded, counts);
        self.supervisor.react_to(counts);
        self.supervisor.publish_drives(commanded);
        let motion_left_s = self.command.motion_left_s();
        (self.emit).update(&self.command, &self.supervisor, measured, tx, counts);
        let driven = |j: usize| self.supervisor.is_engaged(j) && self.emit.reaches(j);
        (self.command).withdraw(driven, commanded);
        if self.supervisor.take_acknowledgement() {
            self.measure.restart_distrusted();
        }

        let record = &mut self.record;
        record.sequence += 1;
        record.stamp_ns = at.now.0;
        self.supervisor.publish(record);
        record.commander.motion_left_s = motion_left_s;
        record.events = counts.as_array();
        record
    }

    /// Counts an event of the loop around the cycle, e.g. a late one, and reacts to it: before the
    /// cycle's `step`.
    pub fn note(&mut self, event: Event, times: u64) {
        if times > 0 {
            self.counts.add_many(event, times - 1);
            self.supervisor.report(event, None, &mut self.counts);
        }
    }

    /// The last record.
    #[must_use]
    pub fn record(&self) -> &CycleRecord {
        &self.record
    }
}
