//! One cycle of the loop.

use can_codec::Frames;
use problem::Problem;
use robot_config::{Robot, TorqueLaw};
use robot_state::{CycleRecord, Event, MAX_FT_SENSORS, MAX_JOINTS, Mode, Settings};

use crate::decide::Supervisor;
use crate::emit::Emit;
use crate::estimate::Estimate;
use crate::events::Counts;
use crate::inputs::{ClientInput, Known, Seen};
use crate::joint::{self, Joints};
use crate::judge::{CommandDelay, Judge};
use crate::measure::Measure;
use crate::mode::{Goal, Modes};
use crate::time::Instants;

/// The stages of a cycle, in their order (docs/architecture.md).
pub const STAGES: [&str; 7] = [
    "measure",
    "estimate",
    "judge",
    "decide",
    "mode",
    "law and limit",
    "emit",
];

/// The computation of one robot, with everything that it remembers from cycle to cycle.
#[derive(Debug)]
pub struct Cycle {
    measure: Measure,
    estimate: Estimate,
    judge: Judge,
    supervisor: Supervisor,
    modes: Modes,
    joints: Joints,
    command_delay: CommandDelay,
    emit: Emit,
    torque_law: TorqueLaw,
    sample_period: f64,
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
        let estimate = Estimate::new(robot)?;
        let modes = Modes::new(robot)?;
        Ok(Self {
            measure: Measure::new(robot).map_err(|problem| problem.of("[filters]"))?,
            judge: Judge::new(robot, &estimate)?,
            estimate,
            supervisor: Supervisor::new(robot, &modes),
            modes,
            joints: Joints::new(robot).map_err(|problem| problem.of("[filters]"))?,
            command_delay: CommandDelay::new(robot),
            emit: Emit::new(robot),
            torque_law: parameters.torque_law,
            sample_period: parameters.timing.sample_period,
            counts: Counts::new(),
            record,
        })
    }

    /// Starts with a fault that was latched before: no set-point leaves until an operator has
    /// acknowledged it.
    pub fn start_with_fault(&mut self, event: Event) {
        self.supervisor.start_with_fault(event);
    }

    /// One cycle: measure, estimate, judge, decide, mode, law and limit, emit.
    ///
    /// Each stage reads what stands before it, and writes its own part of the record.
    pub fn step(
        &mut self,
        at: Instants,
        rx: &Frames,
        client: &ClientInput<'_>,
        tx: &mut Frames,
    ) -> &CycleRecord {
        self.step_watched(at, rx, client, tx, |_| ())
    }

    /// As [`step`](Self::step); `done` is called at the end of each stage with its number in [`STAGES`], for whoever
    /// has a clock.
    pub fn step_watched(
        &mut self,
        at: Instants,
        rx: &Frames,
        client: &ClientInput<'_>,
        tx: &mut Frames,
        mut done: impl FnMut(usize),
    ) -> &CycleRecord {
        self.measure(at, rx, client.settings);
        done(0);
        self.estimate(client.settings);
        done(1);
        self.judge(client.settings);
        done(2);
        let goal = self.decide(client);
        done(3);
        self.set_tasks(&goal, client);
        done(4);
        self.command();
        done(5);
        self.emit(tx);
        done(6);
        self.publish(at)
    }

    fn measure(&mut self, at: Instants, rx: &Frames, settings: Option<&Settings>) {
        let holds = !self.follows();
        let acknowledged = self.supervisor.take_acknowledgement();
        let (record, counts) = (&mut self.record, &mut self.counts);
        let distrusted = self.judge.distrusted();
        (self.measure).learn(distrusted, acknowledged, record);
        let measured = &mut record.measured;
        (self.measure).update(at, rx, settings, holds, measured, counts);
    }

    fn estimate(&mut self, settings: Option<&Settings>) {
        let settings = (settings, self.follows());
        (self.estimate).update(&self.measure, settings, &mut self.record, &mut self.counts);
    }

    fn judge(&mut self, settings: Option<&Settings>) {
        let alone = self.modes.held_by_torque_alone();
        let stages = (&self.measure, &self.estimate, alone);
        (self.judge).update(stages, settings, &mut self.record, &mut self.counts);
    }

    fn decide<'a>(&mut self, client: &ClientInput<'a>) -> Goal<'a> {
        let known = Known {
            soundness: self.judge.soundness(),
            measured: &self.record.measured,
            commanded: &self.record.commanded,
        };
        (self.supervisor).decide(client, &known, &mut self.modes, &mut self.counts)
    }

    fn set_tasks(&mut self, goal: &Goal<'_>, client: &ClientInput<'_>) {
        let (record, counts) = (&mut self.record, &mut self.counts);
        let seen = Seen {
            measured: &record.measured,
            estimated: &record.estimated,
            fast: self.estimate.fast_torques(),
            base_motion: self.estimate.base_motion(),
            loads: self.estimate.gravity_load().loads(),
            observed: self.joints.observed(),
            client: client.reference,
            age_s: client.age_s,
            torque_law: self.torque_law,
            dt: self.sample_period,
        };
        (self.modes).set_tasks(goal, &seen, &mut record.commanded, counts);
    }

    fn command(&mut self) {
        let (record, counts) = (&mut self.record, &mut self.counts);
        let (measured, estimated) = (&record.measured, &record.estimated);
        let commanded = &mut record.commanded;
        let inputs = joint::Inputs {
            measured,
            estimated,
            fast: self.estimate.fast_torques(),
            gravity: self.estimate.gravity_load(),
            soundness: self.judge.soundness(),
        };
        let supervisor = &mut self.supervisor;
        let engaged = |joint| supervisor.is_engaged(joint);
        (self.joints).update(self.modes.tasks(), engaged, &inputs, commanded, counts);
        let (follows, gap) = (self.modes.follow(), self.judge.soundness().gap());
        (self.command_delay).update(follows, gap, measured, commanded, counts);
        supervisor.react_to(counts);
        supervisor.publish_drives(commanded);
    }

    fn emit(&mut self, tx: &mut Frames) {
        let (record, counts) = (&mut self.record, &mut self.counts);
        let (measured, commanded) = (&record.measured, &mut record.commanded);
        (self.emit).update(&self.joints, &self.supervisor, measured, tx, counts);
        let driven = |j: usize| self.supervisor.is_engaged(j) && self.emit.reaches(j);
        self.joints.withdraw(driven, commanded);
    }

    fn publish(&mut self, at: Instants) -> &CycleRecord {
        let record = &mut self.record;
        record.sequence += 1;
        record.stamp_ns = at.now.0;
        self.supervisor.publish(record);
        record.commander.motion_left_s = self.modes.motion_left_s();
        record.events = self.counts.as_array();
        record
    }

    /// A client's mode was followed in the last cycle.
    fn follows(&self) -> bool {
        self.record.mode != Mode::Hold.number()
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
