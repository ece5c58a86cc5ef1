//! The loop in front of a drawn joint, frame by frame.

use crate::plant::Joint;
use can_codec::{Frame, Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use robot_config::slots::{self, Sent};
use robot_config::{Robot, slots::send_len};
use robot_state::{Event, Mode, Reference};

/// Time between cycles, s.
pub(crate) const PERIOD: f64 = 1e-3;

/// The loop, the joint and the client.
pub(crate) struct Rig {
    cycle: Cycle,
    robot: Robot,
    pub(crate) joint: Joint,
    reference: Reference,
    values: Vec<f64>,
    commands: Vec<f64>,
    rx: Frames,
    tx: Frames,
    now: u64,
    fault: Option<(Event, f64)>,
    ended: Option<f64>,
    time: f64,
}

impl Rig {
    /// The loop before its first cycle.
    ///
    /// # Errors
    /// A robot that the cycle cannot run.
    pub(crate) fn new(robot: &Robot, joint: Joint) -> Result<Self, String> {
        Ok(Self {
            cycle: Cycle::new(robot).map_err(|e| e.to_string())?,
            values: vec![0.0; slots::receive_len(&robot.parameters)],
            commands: vec![0.0; send_len(&robot.parameters)],
            robot: robot.clone(),
            joint,
            reference: Reference::default(),
            rx: Frames::new(MAX_FRAMES),
            tx: Frames::new(MAX_FRAMES),
            now: 1_000_000_000,
            fault: None,
            ended: None,
            time: 0.0,
        })
    }

    /// Holds for so long, s: no client is there yet.
    pub(crate) fn hold(&mut self, seconds: f64) {
        for _ in 0..(seconds / PERIOD).round() as usize {
            self.exchange(false);
        }
        let record = self.cycle.record();
        self.reference.joint_count = record.joint_count;
        self.reference.joints[0].q_d = record.measured.joints[0].q;
    }

    /// The desired angle that the client sends, rad.
    pub(crate) fn desired(&self) -> f64 {
        self.reference.joints[0].q_d
    }

    /// K_s as configured, N·m/rad.
    pub(crate) fn stiffness(&self) -> f64 {
        self.robot.parameters.joints[0].gains.k_s
    }

    /// A cycle in mode torque; the mean torque on the link until the next, N·m.
    pub(crate) fn torque(&mut self, tau_d: f64) -> f64 {
        self.reference.mode = Mode::Torque.number();
        self.reference.joints[0].tau_d = tau_d;
        self.exchange(true)
    }

    /// A cycle in mode inverse dynamics, the desired angle moving on at a velocity, rad/s.
    pub(crate) fn follow(&mut self, velocity: f64) -> f64 {
        self.reference.mode = Mode::InverseDynamics.number();
        let desired = &mut self.reference.joints[0];
        desired.q_d += velocity * PERIOD;
        desired.dq_d = velocity;
        self.exchange(true)
    }

    fn exchange(&mut self, speaks: bool) -> f64 {
        self.now += 1_000_000;
        self.time += PERIOD;
        self.reference.sequence += u64::from(speaks);
        self.answer();
        self.tx.clear();
        let at = Instants {
            sync: Stamp(self.now),
            now: Stamp(self.now),
        };
        let client = ClientInput {
            reference: speaks.then_some(&self.reference),
            age_s: 0.001,
            ..ClientInput::default()
        };
        self.cycle.step(at, &self.rx, &client, &mut self.tx);
        self.take();
        let record = self.cycle.record();
        if self.fault.is_none() && record.fault != 0 {
            self.fault = Event::from_number(record.fault).map(|event| (event, self.time));
        }
        if speaks && self.ended.is_none() && record.mode != self.reference.mode {
            self.ended = Some(self.time);
        }
        self.joint.advance()
    }

    fn answer(&mut self) {
        let reading = self.joint.read();
        for (slot, value) in [
            (slots::motor_angle(0), reading.theta),
            (slots::link_angle(0), reading.q),
            (slots::current(0), reading.current),
        ] {
            self.values[slot] = value;
        }
        self.rx.clear();
        let table = &self.robot.receive;
        let mut frame = Frame::zeroed(0, 0, 0, false);
        for index in 0..table.message_count() {
            if table.encode(index, &self.values, &mut frame) {
                frame.stamp_ns = self.now;
                self.rx.push(frame);
            }
        }
    }

    fn take(&mut self) {
        let table = &self.robot.send;
        for frame in self.tx.iter() {
            let Ok(Some(index)) = table.decode(frame, &mut self.commands) else {
                continue;
            };
            for slot in table.slots(index) {
                if let Sent::Command(_) = slots::sent(slot) {
                    self.joint.send(self.commands[slot]);
                }
            }
        }
    }

    /// The fault that was latched, and when, s.
    pub(crate) fn fault(&self) -> Option<(Event, f64)> {
        self.fault
    }

    /// The mode has ended of itself, without a fault.
    pub(crate) fn has_ended(&self) -> bool {
        self.ended.is_some()
    }

    /// Events so far.
    pub(crate) fn events(&self) -> Vec<(Event, u64)> {
        let counts = self.cycle.record().events;
        (Event::ALL.iter())
            .map(|event| (*event, counts[event.index()]))
            .filter(|(_, count)| *count > 0)
            .collect()
    }
}
