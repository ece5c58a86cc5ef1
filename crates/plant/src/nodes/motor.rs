//! What a drive's electronics have: its motor, its encoders, its states, by its own counting.

use crate::controller::{Impedance, SetPoint};
use crate::drive::{Command, DriveReading, DriveSheet};
use crate::drive_states::DriveStates;
use crate::robot::SimRobot;
use crate::transport::Transport;
use robot_config::MountedDrive;
use std::f64::consts::TAU;

/// A drive's motor and encoders.
pub(super) struct Motor<'a> {
    pub(super) robot: &'a mut SimRobot,
    pub(super) mounted: &'a MountedDrive,
    pub(super) transport: &'a mut Transport,
}

impl Motor<'_> {
    pub(super) fn reading(&self) -> DriveReading {
        self.robot.readings().joints[self.mounted.joint]
    }

    pub(super) fn sheet(&self) -> &DriveSheet {
        self.robot.sheet(self.mounted.joint)
    }

    /// It takes positions, not currents.
    pub(super) fn takes_position(&self) -> bool {
        self.sheet().command == Command::Position
    }

    /// The greatest current of its motor, A.
    pub(super) fn current_limit(&self) -> f64 {
        self.robot.current_limit(self.mounted.joint)
    }

    /// It makes no more current than that from now on, A.
    pub(super) fn limit_current(&mut self, limit: f64) {
        self.robot.limit_current(self.mounted.joint, limit);
    }

    pub(super) fn states(&mut self) -> Option<&mut DriveStates> {
        self.robot.drive_states(self.mounted.joint)
    }

    /// The motor's angle, rad, as it counts.
    pub(super) fn angle(&self) -> f64 {
        self.mounted.motor.counted(self.reading().theta)
    }

    /// The motor's velocity, rad/s, as it counts.
    pub(super) fn velocity(&self) -> f64 {
        self.mounted.motor.direction * self.reading().omega
    }

    /// The current, A, as it counts.
    pub(super) fn current(&self) -> f64 {
        self.mounted.current.counted(self.reading().current)
    }

    /// Counts of the motor's encoder.
    pub(super) fn motor_counts(&self) -> f64 {
        self.angle() / TAU * self.sheet().motor_counts_per_turn
    }

    /// Counts of the link's encoder.
    pub(super) fn link_counts(&self) -> f64 {
        let q = self.mounted.link.counted(self.reading().q);
        q / TAU * self.sheet().link_counts_per_turn
    }

    /// Follows a position in counts of one of the encoders from when its frame acts.
    pub(super) fn follow_counts(&mut self, counts: f64, at_link: bool) {
        let sheet = self.sheet();
        let set_point = if at_link {
            let counted = counts * TAU / sheet.link_counts_per_turn;
            self.mounted.link.quantity(counted)
        } else {
            let counted = counts * TAU / sheet.motor_counts_per_turn;
            self.mounted.motor.quantity(counted) / sheet.gear_ratio
        };
        self.follow(set_point);
    }

    /// Follows a current, A, as it counts.
    pub(super) fn follow_current(&mut self, current: f64) {
        let set_point = self.mounted.current.quantity(current);
        self.follow(set_point);
    }

    /// Follows a spring and a damper about the output's position, by its own counting: `position`, rad,
    /// `velocity`, rad/s, `torque`, N·m, `kp`, N·m/rad, `kd`, N·m·s/rad.
    pub(super) fn follow_output(&mut self, [position, velocity, torque, kp, kd]: [f64; 5]) {
        let (mount, sheet) = (self.mounted.motor, self.sheet());
        let ratio = sheet.gear_ratio;
        let per_torque = 1.0 / (ratio * sheet.torque_constant);
        let asked = Impedance {
            position: mount.quantity(position * ratio) / ratio,
            velocity: mount.direction * velocity,
            stiffness: kp * per_torque,
            damping: kd * per_torque,
            feed_forward: mount.direction * torque * per_torque,
        };
        if let Some(delay) = self.transport.next_delay() {
            let joint = self.mounted.joint;
            (self.robot).follow_after(joint, SetPoint::Impedance(asked), delay);
        }
    }

    /// No torque, at once.
    pub(super) fn let_go(&mut self) {
        let none = SetPoint::Impedance(Impedance::default());
        self.robot.follow_after(self.mounted.joint, none, 0.0);
    }

    /// The output's position, rad, velocity, rad/s, and torque, N·m, as it counts.
    pub(super) fn output(&self) -> [f64; 3] {
        let (ratio, reading) = (self.sheet().gear_ratio, self.reading());
        let torque = self.mounted.motor.direction * reading.report.torque;
        [self.angle() / ratio, self.velocity() / ratio, torque]
    }

    fn follow(&mut self, set_point: f64) {
        if let Some(delay) = self.transport.next_delay() {
            let joint = self.mounted.joint;
            self.robot.command_after(joint, set_point, delay);
        }
    }

    /// It hears no control words.
    pub(super) fn is_deaf(&mut self) -> bool {
        let faults = self.robot.drive_faults(self.mounted.joint);
        faults.is_some_and(|faults| faults.deaf)
    }
}
