//! Measure: from frames to joint angles, currents, wrenches and motion, in SI units.

use can_codec::{DecodeError, Frames, Table};
use estimators::front_end::FrontEnd;
use estimators::joint::JointSample;
use joint_file::JointFile;
use robot_config::{Robot, Sampled, Sampling, slots};
use robot_state::{CycleRecord, Event, Settings, Wrench, measured_flags};

mod align;
mod filtered;
mod ft_offset;

use crate::error::CycleError;
use crate::events::Counts;
use crate::time::{Instants, SECONDS_PER_NS};
use align::{AlignedBank, OVERDUE, signals};
use filtered::{AXES, Filtered};
use ft_offset::FtInput;

pub(crate) use filtered::whole_body;

/// What the joints and sensors say about themselves in this cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Readiness {
    /// Every joint has answered at least once.
    pub(crate) seen: bool,
    /// Moreover, every filter is full.
    pub(crate) ready: bool,
    /// Some joint has been silent for longer than allowed.
    pub(crate) stale: bool,
}

/// The messages that one joint or sensor needs.
#[derive(Debug)]
struct Source {
    messages: Vec<usize>,
    /// Slots whose values must be finite.
    slots: Vec<usize>,
    sampling: Sampling,
}

/// The joints and sensors of a robot, followed from cycle to cycle.
#[derive(Debug)]
pub(crate) struct Measure {
    table: Table,
    slots: Vec<f64>,
    /// Instant of each message's last frame; none before the first.
    stamps: Vec<Option<u64>>,
    /// The message has come since the last cycle.
    fresh: Vec<bool>,
    joints: Vec<Source>,
    sensors: Vec<Source>,
    ft_inputs: Vec<FtInput>,
    imu: Option<Source>,
    stale_after_s: f64,
    sample_period: f64,
    sends_velocity: Vec<bool>,
    /// Every joint's readings made the sample of its estimators.
    front_ends: Vec<FrontEnd>,
    /// For the torque from F/T sensors and IMU, contacts and feedback.
    slow: Filtered,
    /// For the torque now.
    quick: Filtered,
    /// q of every joint, then theta of every joint: first derivative.
    control_filter: AlignedBank,
    angles: Vec<f64>,
    both_angles: Vec<f64>,
    axes: Vec<f64>,
    samples: Vec<JointSample>,
}

impl Measure {
    pub(crate) fn new(robot: &Robot) -> Result<Self, CycleError> {
        let parameters = &robot.parameters;
        let table = robot.receive.clone();
        let n = parameters.joints.len();
        let axes = AXES * (parameters.ft_sensors.len() + 1);
        let source = |needed: Vec<usize>, sampling: Sampling| Source {
            messages: (0..table.message_count())
                .filter(|&m| table.slots(m).any(|slot| needed.contains(&slot)))
                .collect(),
            slots: needed,
            sampling,
        };
        let period = parameters.timing.sample_period;
        let [_, control, _] = signals(robot);
        let joints = parameters.joints.iter().enumerate().map(|(j, joint)| {
            let mut needed = vec![
                slots::motor_angle(j),
                slots::link_angle(j),
                slots::current(j),
            ];
            if joint.has_velocity {
                needed.push(slots::velocity(j));
            }
            if joint.has_status {
                needed.push(slots::status(j));
            }
            source(needed, joint.sampling)
        });
        let sensors = parameters.ft_sensors.iter().enumerate().map(|(s, ft)| {
            let temperature = ft.has_temperature.then(|| slots::ft_temperature(s));
            let axes = (0..AXES).map(|axis| slots::ft(s, axis));
            source(axes.chain(temperature).collect(), ft.sampling)
        });
        Ok(Self {
            slots: vec![0.0; slots::receive_len(parameters)],
            stamps: vec![None; table.message_count()],
            fresh: vec![false; table.message_count()],
            joints: joints.collect(),
            sensors: sensors.collect(),
            ft_inputs: parameters.ft_sensors.iter().map(FtInput::new).collect(),
            imu: parameters.imu.as_ref().map(|imu| {
                let gyro = (0..3).map(slots::gyro);
                let axes = gyro.chain((0..3).map(slots::accelerometer));
                source(axes.collect(), imu.sampling)
            }),
            stale_after_s: parameters.timing.stale_after,
            sample_period: period,
            sends_velocity: parameters.joints.iter().map(|j| j.has_velocity).collect(),
            front_ends: (parameters.joints.iter())
                .map(|joint| {
                    let window = joint.calibration.as_ref().map(JointFile::velocity_window);
                    FrontEnd::new(joint.encoders, window)
                })
                .collect::<Result<_, _>>()?,
            slow: Filtered::new(robot, parameters.filters.long)?,
            quick: Filtered::new(robot, parameters.filters.short)?,
            control_filter: AlignedBank::new(&control, parameters.filters.control, period)?,
            angles: vec![f64::NAN; n],
            both_angles: vec![f64::NAN; 2 * n],
            axes: vec![f64::NAN; axes],
            samples: vec![JointSample::default(); n],
            table,
        })
    }

    /// Every joint's sample of this cycle, as the joint estimators want it.
    pub(crate) fn samples(&self) -> &[JointSample] {
        &self.samples
    }

    /// The filtered signals, as late as `filter_delay_s` of the record says.
    pub(crate) fn slow(&self) -> &Filtered {
        &self.slow
    }

    /// The same through short filters.
    pub(crate) fn quick(&self) -> &Filtered {
        &self.quick
    }

    pub(crate) fn update(
        &mut self,
        at: Instants,
        rx: &Frames,
        settings: Option<&Settings>,
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) -> Readiness {
        self.decode(rx, counts);
        self.read_joints(at, record, counts);
        self.take_offsets(settings);
        self.read_sensors(at, record, counts);
        (self.slow).update(&self.angles, &self.axes, &self.stamps, at.sync);
        (self.quick).update(&self.angles, &self.axes, &self.stamps, at.sync);
        (self.control_filter).update(&self.both_angles, &self.stamps, at.sync);
        self.tell_joints(record);
        self.tell_sensors(record);
        let joints = record.joints.iter().take(self.joints.len());
        let mut flags = joints.fold(0, |all, joint| all | joint.measured.flags);
        let stale = flags & measured_flags::STALE != 0;
        let seen = flags & measured_flags::NEVER == 0;
        let sensors = record.ft.iter().take(self.sensors.len());
        flags |= sensors.fold(0, |all, sensor| all | sensor.flags) | record.imu.flags;
        let unready = measured_flags::NEVER | measured_flags::SETTLING;
        Readiness {
            seen,
            ready: flags & unready == 0,
            stale,
        }
    }

    fn decode(&mut self, rx: &Frames, counts: &mut Counts) {
        self.fresh.fill(false);
        counts.add_many(Event::ReceiveOverflow, rx.overflow());
        for frame in rx {
            if frame.error {
                counts.add(Event::BusErrorFrame);
                continue;
            }
            match self.table.decode(frame, &mut self.slots) {
                Ok(Some(message)) => {
                    if let Some(fresh) = self.fresh.get_mut(message) {
                        *fresh = true;
                    }
                    if let Some(stamp) = self.stamps.get_mut(message) {
                        *stamp = Some(frame.stamp_ns);
                    }
                }
                Ok(None) => {}
                Err(DecodeError::UnknownId) => counts.add(Event::FrameUnknownId),
                Err(DecodeError::WrongLength) => counts.add(Event::FrameWrongLength),
            }
        }
    }

    /// Whether the source has a whole and finite sample for this cycle; its age and flags.
    fn look(&self, source: &Source, at: Instants, counts: &mut Counts) -> (bool, f64, u32) {
        let mut stamps = source
            .messages
            .iter()
            .map(|&m| self.stamps.get(m).copied().flatten());
        // The oldest message counts: the sample is whole only with all of them.
        let oldest = stamps.try_fold(u64::MAX, |oldest, stamp| Some(oldest.min(stamp?)));
        let Some(oldest) = oldest else {
            return (
                false,
                f64::INFINITY,
                measured_flags::NEVER | measured_flags::MISSED,
            );
        };
        let age = at.now.0.saturating_sub(oldest) as f64 * SECONDS_PER_NS;
        let all_fresh = source
            .messages
            .iter()
            .all(|&m| self.fresh.get(m).copied().unwrap_or(false));
        let finite = source
            .slots
            .iter()
            .all(|&slot| self.slots.get(slot).is_some_and(|x| x.is_finite()));
        if all_fresh && !finite {
            counts.add(Event::SignalNotFinite);
        }
        let there = match source.sampling.sampled {
            Sampled::AtSync => all_fresh,
            // It comes when it likes: until the next is overdue the last serves, at its age.
            Sampled::WhenSent { period } => {
                at.sync.0.abs_diff(oldest) as f64 * SECONDS_PER_NS <= OVERDUE * period
            }
        };
        let mut flags = 0;
        if !(there && finite) {
            flags |= measured_flags::MISSED;
        }
        if age > self.stale_after_s {
            flags |= measured_flags::STALE;
        }
        (there && finite, age, flags)
    }

    fn read_joints(&mut self, at: Instants, record: &mut CycleRecord, counts: &mut Counts) {
        let n = self.joints.len();
        for j in 0..n {
            let (fresh, age, mut flags) = self.look(&self.joints[j], at, counts);
            let slot = |slot: usize| if fresh { self.slots[slot] } else { f64::NAN };
            self.samples[j] = self.front_ends[j].update(
                slot(slots::motor_angle(j)),
                slot(slots::link_angle(j)),
                slot(slots::current(j)),
            );
            let angles = *self.front_ends[j].angles();
            flags |= angles.flags;
            if flags & measured_flags::MISSED != 0 {
                counts.add(Event::JointMissed);
            }
            if flags & measured_flags::JUMP != 0 {
                counts.add(Event::EncoderJump);
            }
            let measured = &mut record.joints[j].measured;
            if angles.flags == 0 {
                measured.q = angles.q;
                measured.theta = angles.theta;
                measured.torsion = angles.torsion;
            } else if flags & (measured_flags::NEVER | measured_flags::STALE) == 0 {
                // Bridged: the joint goes on as it went. A lost reply must not step the torque.
                measured.q += measured.dq * self.sample_period;
                measured.theta += measured.omega * self.sample_period;
            }
            if fresh {
                measured.current = self.slots[slots::current(j)];
                measured.status = self.slots[slots::status(j)] as u32;
                if self.sends_velocity[j] {
                    measured.omega = self.slots[slots::velocity(j)];
                }
            }
            measured.age_s = age;
            measured.flags = flags;
            let unused = angles.flags != 0;
            self.angles[j] = if unused { f64::NAN } else { angles.q };
            self.both_angles[j] = self.angles[j];
            self.both_angles[n + j] = if unused { f64::NAN } else { angles.theta };
        }
    }

    fn tell_joints(&mut self, record: &mut CycleRecord) {
        let n = self.joints.len();
        let (late, quick) = (self.slow.input(), &self.control_filter);
        record.filter_delay_s = self.slow.delay_s();
        for j in 0..n {
            let measured = &mut record.joints[j].measured;
            (measured.q_hat, measured.dq_hat) = (late.q[j], late.dq[j]);
            measured.ddq_hat = late.ddq[j];
            measured.dq = quick.outputs(j)[1];
            if !self.sends_velocity[j] {
                measured.omega = quick.outputs(n + j)[1];
            }
            if self.slow.joint_settling(j) {
                measured.flags |= measured_flags::SETTLING;
            }
            let sample = &mut self.samples[j];
            if !self.front_ends[j].has_velocities() {
                (sample.dq, sample.omega) = (measured.dq, measured.omega);
            }
            sample.flags = measured.flags;
        }
    }

    /// Offsets of F/T sensors move towards those that a tare has found.
    fn take_offsets(&mut self, settings: Option<&Settings>) {
        let (period_s, inputs) = (self.sample_period, &mut self.ft_inputs);
        for (s, input) in inputs.iter_mut().enumerate() {
            let tare = settings.map_or(Wrench::default(), |settings| settings.ft_offset[s]);
            input.follow(&tare, period_s);
        }
    }

    fn read_sensors(&mut self, at: Instants, record: &mut CycleRecord, counts: &mut Counts) {
        self.axes.fill(f64::NAN);
        for s in 0..self.sensors.len() {
            let (fresh, age, flags) = self.look(&self.sensors[s], at, counts);
            let sensor = &mut record.ft[s];
            sensor.age_s = age;
            sensor.flags = flags;
            let input = &mut self.ft_inputs[s];
            sensor.offset = input.offset();
            if fresh {
                let raw: [f64; AXES] = std::array::from_fn(|axis| self.slots[slots::ft(s, axis)]);
                sensor.temperature = self.slots[slots::ft_temperature(s)];
                sensor.measured = input.wrench(&raw, sensor.temperature);
                self.axes[AXES * s..][..3].copy_from_slice(&sensor.measured.force);
                self.axes[AXES * s + 3..][..3].copy_from_slice(&sensor.measured.torque);
            } else {
                counts.add(Event::SensorMissed);
            }
        }
        let Some(source) = &self.imu else {
            return;
        };
        let (fresh, age, flags) = self.look(source, at, counts);
        record.imu.age_s = age;
        record.imu.flags = flags;
        if fresh {
            record.imu.gyro = std::array::from_fn(|axis| self.slots[slots::gyro(axis)]);
            record.imu.accelerometer =
                std::array::from_fn(|axis| self.slots[slots::accelerometer(axis)]);
            let imu = AXES * self.sensors.len();
            self.axes[imu..][..3].copy_from_slice(&record.imu.gyro);
            self.axes[imu + 3..][..3].copy_from_slice(&record.imu.accelerometer);
        } else {
            counts.add(Event::SensorMissed);
        }
    }

    fn tell_sensors(&self, record: &mut CycleRecord) {
        let late = self.slow.input();
        for (s, filtered) in late.ft.iter().enumerate() {
            record.ft[s].filtered = *filtered;
            if self.slow.sensor_settling(s) {
                record.ft[s].flags |= measured_flags::SETTLING;
            }
        }
        if self.imu.is_some() {
            record.imu.gyro_hat = late.imu.angular_velocity.into();
            record.imu.accelerometer_hat = late.imu.proper_acceleration.into();
            record.imu.angular_acceleration_hat = late.imu.angular_acceleration.into();
            if self.slow.sensor_settling(self.sensors.len()) {
                record.imu.flags |= measured_flags::SETTLING;
            }
        }
    }
}
