//! The filtered signals in the record.

use robot_state::{MeasuredRecord, measured_flags};

use super::Measure;

impl Measure {
    pub(super) fn publish_joints(&mut self, measured: &mut MeasuredRecord) {
        let n = self.joints.len();
        let (long, control) = (self.long.input(), &self.control_filter);
        measured.filter_delay_s = self.long.delay_s();
        for (j, measured) in measured.joints.iter_mut().enumerate().take(n) {
            (measured.q_hat, measured.dq_hat) = (long.q[j], long.dq[j]);
            measured.ddq_hat = long.ddq[j];
            measured.dq = control.outputs(j)[1];
            if !self.sends_velocity[j] {
                measured.omega = control.outputs(n + j)[1];
            }
            if self.long.joint_settling(j) {
                measured.flags |= measured_flags::SETTLING;
            }
            let sample = &mut self.samples[j];
            if !self.front_ends[j].has_velocities() {
                (sample.dq, sample.omega) = (measured.dq, measured.omega);
            }
            sample.flags = measured.flags;
        }
    }

    pub(super) fn publish_sensors(&self, measured: &mut MeasuredRecord) {
        let long = self.long.input();
        for (s, (sensor, filtered)) in measured.ft.iter_mut().zip(long.ft).enumerate() {
            sensor.wrench_hat = *filtered;
            if self.long.sensor_settling(s) {
                sensor.flags |= measured_flags::SETTLING;
            }
        }
        self.publish_imus(measured);
    }
}
