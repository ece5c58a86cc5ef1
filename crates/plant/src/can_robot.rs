//! The simulated robot behind its CAN buses.

use crate::drive::{Command, DriveSheet};
use crate::drive_states::DriveStates;
use crate::kinematic_error::KinematicError;
use crate::nodes::{Around, Nodes};
use crate::parameters::SimParameters;
use crate::plan::{JointPlan, Plan};
use crate::random::Random;
use crate::readings::six;
use crate::robot::SimRobot;
use crate::transport::Transport;
use crate::truth::Truth;
use can_codec::{DecodeError, Frame, Frames, Table};
use nalgebra::{Matrix6, Vector6};
use problem::Problem;
use robot_config::slots::{Sent, Source};
use robot_config::{FtParameters, JointParameters, Robot, slots};
use robot_state::Wrench;
use std::f64::consts::TAU;

/// Periods that pass from one SYNC to the next at most: without a daemon time stands still.
const MOST_PERIODS: f64 = 20.0;

/// Periods between two messages that tell only what changes slowly.
const TOLD_EVERY: u64 = 50;

/// Answers SYNC as drives, F/T sensors and IMUs do, and follows commands.
///
/// Time passes by one period each cycle, or by as many as the daemon left out: at the first SYNC of a bus
/// that has already been answered since the last period. So all buses answer from the same instant
/// whatever the order of their SYNCs, and a SYNC lost on one bus does not stop the others. A daemon that is
/// late by less than half a period is waited for. Frames that sensors with clocks of their own have sent
/// meanwhile on any bus arrive then too, with earlier stamps.
#[derive(Debug, Clone)]
pub struct CanRobot {
    robot: SimRobot,
    receive: Table,
    send: Table,
    sync: Vec<Frame>,
    /// Buses that have been answered in this period.
    answered: Vec<bool>,
    /// Instant of the SYNC with which it began, ns.
    synced: Option<u64>,
    period_ns: f64,
    /// Periods since the start.
    periods: u64,
    /// One per F/T sensor.
    electronics: Vec<Electronics>,
    values: Vec<f64>,
    commands: Vec<f64>,
    transport: Transport,
    /// Drives that are nodes of their buses, and for each message to the loop whether it is one of theirs.
    nodes: Nodes,
    of_nodes: Vec<bool>,
    unknown: u64,
    undecoded: u64,
}

impl CanRobot {
    /// A robot in balance at the pose of `sim.toml`, its drives holding it.
    ///
    /// # Errors
    /// Parts that do not fit together, with their key.
    pub fn new(robot: &Robot, urdf_text: &str, sim: &SimParameters) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let plan = Plan::of(robot)?;
        let mut simulated = SimRobot::new(&plan, urdf_text, &parameters.urdf_path, sim)?;
        simulated.advance();
        let mut transport = Transport::new(
            &sim.transport,
            parameters.timing.sample_period,
            Random::new(sim.seed, 60),
        );
        let nodes = Nodes::new(robot, sim, &mut simulated, &mut transport)?;
        let mut can = Self {
            of_nodes: (0..robot.receive.message_count())
                .map(|index| robot.receive.slots(index).any(|slot| nodes.has_slot(slot)))
                .collect(),
            nodes,
            robot: simulated,
            receive: robot.receive.clone(),
            send: robot.send.clone(),
            sync: robot.sync.clone(),
            answered: vec![true; parameters.buses.len()],
            synced: None,
            period_ns: parameters.timing.sample_period * 1e9,
            periods: 0,
            electronics: (parameters.ft_sensors.iter())
                .map(|ft| Electronics::of(ft, sim.ft_sensor.ignores_offset))
                .collect(),
            values: vec![0.0; slots::receive_len(parameters)],
            commands: vec![0.0; slots::send_len(parameters)],
            transport,
            unknown: 0,
            undecoded: 0,
        };
        can.fill_values();
        Ok(can)
    }

    /// Takes the daemon's frames in their order; appends the answers to `out`.
    pub fn exchange(&mut self, from_daemon: &Frames, now_ns: u64, out: &mut Frames) {
        self.poll(now_ns, out);
        for frame in from_daemon.iter() {
            let is_sync = |s: &&Frame| s.bus == frame.bus && s.id == frame.id && !frame.error;
            if self.sync.iter().any(|s| is_sync(&s)) {
                let stamped = if frame.stamp_ns == 0 {
                    now_ns
                } else {
                    frame.stamp_ns
                };
                self.answer(frame.bus, stamped, now_ns, out);
            } else if !self.hear(frame, now_ns, out) {
                self.follow_command(frame);
            }
        }
    }

    /// What drives that are nodes do by their own clocks. Time passes for them as for all: one that has lost its
    /// master stops without any SYNC.
    fn poll(&mut self, now_ns: u64, out: &mut Frames) {
        if self.nodes.is_empty() {
            return;
        }
        if self.nodes.send_by_themselves() {
            let last = *self.synced.get_or_insert(now_ns);
            let whole = now_ns.saturating_sub(last) as f64 / self.period_ns + 1e-6;
            let periods = whole.floor().min(MOST_PERIODS);
            if periods >= 1.0 {
                self.advance(periods as u32);
                let passed = (whole.floor() * self.period_ns) as u64;
                self.synced = Some(last + passed);
            }
        } else if self.nodes.are_on(&mut self.robot)
            && let Some(last) = self.synced
        {
            let periods = now_ns.saturating_sub(last) as f64 / self.period_ns;
            if periods > MOST_PERIODS {
                self.advance(MOST_PERIODS as u32);
                self.synced = Some(now_ns);
            }
        }
        let mut around = Around {
            robot: &mut self.robot,
            transport: &mut self.transport,
            now: now_ns,
            out,
        };
        self.nodes.poll(&mut around);
    }

    /// Time passes on a bus of actuators, on which no SYNC says so.
    fn advance(&mut self, periods: u32) {
        for _ in 0..periods {
            self.robot.advance();
            self.periods = self.periods.wrapping_add(1);
        }
        self.fill_values();
        // A SYNC on another bus in this period is answered from the same instant.
        self.answered.fill(false);
    }

    /// Hands a frame to the drives that are nodes; true if one of them listens for it.
    fn hear(&mut self, frame: &Frame, now_ns: u64, out: &mut Frames) -> bool {
        if self.nodes.answer_only(frame.bus) {
            // The first question of a cycle.
            let last = *self.synced.get_or_insert(now_ns);
            let elapsed = now_ns.saturating_sub(last) as f64 / self.period_ns;
            let periods = elapsed.round().min(MOST_PERIODS);
            if periods >= 1.0 {
                self.advance(periods as u32);
                self.synced = Some(now_ns);
            }
        }
        let mut around = Around {
            robot: &mut self.robot,
            transport: &mut self.transport,
            now: now_ns,
            out,
        };
        !frame.error && self.nodes.hear(frame, &mut around)
    }

    /// Answers a SYNC that arrived at `stamped`.
    fn answer(&mut self, bus: u8, stamped: u64, now_ns: u64, out: &mut Frames) {
        if self.answered.get(usize::from(bus)).copied().unwrap_or(true) {
            for left_out in (0..self.periods_until(stamped)).rev() {
                self.robot.advance();
                self.periods = self.periods.wrapping_add(1);
                self.fill_values();
                let since_ns = (f64::from(left_out) * self.period_ns) as u64;
                self.publish_sent(now_ns.saturating_sub(since_ns), out);
            }
            self.answered.fill(false);
        }
        if let Some(answered) = self.answered.get_mut(usize::from(bus)) {
            *answered = true;
        }
        let mut frame = Frame::zeroed(bus, 0, 0, false);
        for index in 0..self.receive.message_count() {
            let ours = (self.receive.message(index)).is_some_and(|entry| entry.bus == bus);
            if ours && self.answers(index) && self.receive.encode(index, &self.values, &mut frame) {
                frame.stamp_ns = now_ns;
                out.push(frame);
            }
        }
        let mut around = Around {
            robot: &mut self.robot,
            transport: &mut self.transport,
            now: now_ns,
            out,
        };
        self.nodes.sync(bus, &mut around);
    }

    /// Periods since the last SYNC that began one.
    fn periods_until(&mut self, stamped: u64) -> u32 {
        let last = self.synced.replace(stamped).unwrap_or(stamped);
        let elapsed = stamped.saturating_sub(last) as f64 / self.period_ns;
        elapsed.round().clamp(1.0, MOST_PERIODS) as u32
    }

    /// True for a message with a source that answers SYNC, or in this period for one that reports only what changes
    /// slowly.
    fn answers(&self, message: usize) -> bool {
        let slots = || self.receive.slots(message);
        if self.of_nodes[message] {
            return false;
        }
        if slots().all(slots::is_reported) {
            return self.periods.is_multiple_of(TOLD_EVERY);
        }
        slots().any(|slot| !slots::is_reported(slot) && self.robot.answers(slots::source(slot)))
    }

    /// Frames of sensors with clocks of their own, up to now.
    fn publish_sent(&mut self, now_ns: u64, out: &mut Frames) {
        let now = self.robot.time();
        let mut frame = Frame::zeroed(0, 0, 0, false);
        for at in 0..self.robot.readings().sent.len() {
            let sent = self.robot.readings().sent[at];
            if sent.stamp > now {
                continue;
            }
            self.set(sent.source, &sent.values);
            for index in 0..self.receive.message_count() {
                let mut slots = self.receive.slots(index);
                let its = slots
                    .any(|slot| !slots::is_reported(slot) && slots::source(slot) == sent.source);
                let sends = its && !self.answers(index) && !self.of_nodes[index];
                if sends && self.receive.encode(index, &self.values, &mut frame) {
                    let before_ns = ((now - sent.stamp) * 1e9).round() as u64;
                    frame.stamp_ns = now_ns.saturating_sub(before_ns);
                    out.push(frame);
                }
            }
        }
    }

    fn follow_command(&mut self, frame: &Frame) {
        match self.send.decode(frame, &mut self.commands) {
            Ok(Some(index)) => {
                // Control words arrive at once: a drive's states take their own time.
                let delay = self.transport.next_delay();
                for slot in self.send.slots(index) {
                    let Some(&value) = self.commands.get(slot) else {
                        continue;
                    };
                    match slots::sent(slot) {
                        Sent::Command(joint) => {
                            if let Some(delay) = delay {
                                self.robot.command_after(joint, value, delay);
                            }
                        }
                        Sent::Control(joint) => {
                            let faults = self.robot.drive_faults(joint);
                            if faults.is_some_and(|faults| faults.deaf) {
                                continue;
                            }
                            if let Some(states) = self.robot.drive_states(joint) {
                                states.control(value as u32);
                            }
                        }
                    }
                }
            }
            Ok(None) => {}
            Err(error) => {
                self.unknown += 1;
                self.undecoded += u64::from(error == DecodeError::WrongLength);
            }
        }
    }

    fn fill_values(&mut self) {
        for j in 0..self.robot.readings().joints.len() {
            let joint = self.robot.readings().joints[j];
            let status = f64::from(joint.status);
            let values = [
                joint.theta,
                joint.q,
                joint.current,
                joint.omega,
                status,
                0.0,
            ];
            self.set(Source::Joint(j), &values);
            let report = joint.report;
            for (slot, value) in [
                (slots::temperature(j), report.temperature),
                (slots::voltage(j), report.voltage),
                (slots::drive_torque(j), report.torque),
                (slots::drive_error(j), f64::from(report.error)),
            ] {
                if let Some(place) = self.values.get_mut(slot) {
                    *place = value;
                }
            }
        }
        for s in 0..self.robot.readings().ft.len() {
            let Wrench { force, torque } = self.robot.readings().ft[s];
            let temperature = self.robot.readings().ft_temperature[s];
            self.set(Source::Ft(s), &six(force, torque));
            if let Some(place) = self.values.get_mut(slots::ft_temperature(s)) {
                *place = temperature;
            }
        }
        for i in 0..self.robot.readings().imus.len() {
            let imu = self.robot.readings().imus[i];
            self.set(Source::Imu(i), &imu);
        }
    }

    /// Stores a source's readings in the values that frames encode.
    fn set(&mut self, source: Source, values: &[f64; 6]) {
        let mut set = |slot: usize, value: f64| {
            if let Some(place) = self.values.get_mut(slot) {
                *place = value;
            }
        };
        match source {
            Source::Joint(j) => {
                let [theta, q, current, omega, status, _] = *values;
                set(slots::motor_angle(j), theta);
                set(slots::link_angle(j), q);
                set(slots::current(j), current);
                set(slots::velocity(j), omega);
                set(slots::status(j), status);
            }
            Source::Ft(s) => {
                for (axis, value) in self.electronics[s].raw(values).iter().enumerate() {
                    set(slots::ft(s, axis), *value);
                }
            }
            Source::Imu(i) => {
                let [x, y, z, a, b, c] = *values;
                for (axis, (gyro, accelerometer)) in
                    [x, y, z].into_iter().zip([a, b, c]).enumerate()
                {
                    set(slots::gyro(i, axis), gyro);
                    set(slots::accelerometer(i, axis), accelerometer);
                }
            }
        }
    }

    /// The true quantities at the last sampling of the sensors. Joints in config order.
    #[must_use]
    pub fn truth(&self) -> &Truth {
        self.robot.truth()
    }

    /// The robot behind the buses.
    #[must_use]
    pub fn robot(&self) -> &SimRobot {
        &self.robot
    }

    /// The states of a joint's drive, if it has any: to make it fail.
    #[must_use]
    pub fn drive_states(&mut self, joint: usize) -> Option<&mut DriveStates> {
        self.robot.drive_states(joint)
    }

    /// The robot behind the buses, to load its joints and to break it.
    #[must_use]
    pub fn robot_mut(&mut self) -> &mut SimRobot {
        &mut self.robot
    }

    /// Number of frames with an unknown id or of the wrong length.
    #[must_use]
    pub fn unknown_frames(&self) -> u64 {
        self.unknown
    }

    /// Number of frames of the wrong length among them.
    #[must_use]
    pub fn undecoded_frames(&self) -> u64 {
        self.undecoded
    }
}

/// Signals of an F/T sensor for a measured wrench: its calibration sheet, the configuration, turns
/// them back into that wrench at the reference temperature.
#[derive(Debug, Clone)]
struct Electronics {
    sheet: Matrix6<f64>,
    unloaded: Vector6<f64>,
}

impl Electronics {
    fn of(ft: &FtParameters, ignores_offset: bool) -> Self {
        let rows = &ft.conditioning.calibration;
        let calibration = Matrix6::from_fn(|i, j| rows[i][j]);
        Self {
            // The configuration was checked: the matrix is invertible.
            sheet: (calibration.try_inverse()).unwrap_or_else(Matrix6::identity),
            unloaded: if ignores_offset {
                Vector6::zeros()
            } else {
                ft.conditioning.offset.into()
            },
        }
    }

    fn raw(&self, wrench: &[f64; 6]) -> Vector6<f64> {
        self.sheet * (Vector6::from(*wrench) + self.unloaded)
    }
}

impl Plan {
    /// The plan of a configured robot.
    ///
    /// # Errors
    /// Drives that are not simulated, with their key.
    pub fn of(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        Ok(Plan {
            floating: parameters.base == dynamics::Base::Floating,
            joints: (parameters.joints.iter().enumerate())
                .map(|(j, joint)| {
                    let nodes = &robot.nodes.mounted;
                    joint_plan(joint, nodes.iter().any(|node| node.joint == j))
                })
                .collect::<Result<_, _>>()?,
            ft_sensors: (parameters.ft_sensors.iter())
                .map(|ft| ft.sensor.frame.clone())
                .collect(),
            imus: (parameters.imus.iter())
                .map(|imu| imu.frame.clone())
                .collect(),
            period: parameters.timing.sample_period,
        })
    }
}

fn joint_plan(joint: &JointParameters, is_node: bool) -> Result<JointPlan, Problem> {
    let estimator = &joint.estimator;
    let known = &estimator.kinematic_error;
    let pairs = |list: &[(f64, f64)]| list.iter().map(|(a, b)| [*a, *b]).collect();
    // A drive that is only watched is switched by others: it is on.
    let controlled = joint.drive_profile.as_ref().filter(|p| p.control.is_some());
    if !is_node && controlled.is_some_and(|profile| !profile.is_cia402()) {
        let what = format!("drive.{}.state: not CiA 402", joint.drive);
        let allowed = "profile = \"cia402\": other drives are not simulated";
        return Err(Problem::new(what, allowed));
    }
    Ok(JointPlan {
        name: joint.name.clone(),
        drive: joint.drive.clone(),
        sheet: DriveSheet {
            kind: joint.kind,
            gear_ratio: estimator.gear_ratio,
            torque_constant: estimator.wave_generator.torque_constant,
            rotor_inertia: joint.rotor_inertia,
            motor_counts_per_turn: TAU / estimator.motor_resolution,
            link_counts_per_turn: TAU / estimator.link_resolution,
            command: if joint.takes_position() {
                Command::Position
            } else {
                Command::Current
            },
            kinematic_error: KinematicError {
                constant: known.a0,
                link: pairs(&known.link),
                link_frequency: known.w_link,
                motor: pairs(&known.motor),
                motor_frequency: known.w_motor,
            },
        },
        states: controlled.is_some(),
    })
}
