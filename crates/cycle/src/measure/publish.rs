//! The filtered signals in the record.

use robot_state::{MeasuredRecord, measured_flags};

use super::Measure;

impl Measure {
    pub(super) fn publish_joints(&mut self, measured: &mut MeasuredRecord) {
        let n = self.joints.len();
        let readers = self.joints.iter().zip(&mut self.samples);
        let (long, control) = (self.long.input(), &self.control_filter);
        measured.filter_delay_s = self.long.delay_s();
        for (j, ((reader, sample), measured)) in readers.zip(&mut measured.joints).enumerate() {
            (measured.q_hat, measured.dq_hat) = (long.q[j], long.dq[j]);
            measured.ddq_hat = long.ddq[j];
            measured.dq = control.outputs(j)[1];
            if !reader.sends_velocity() {
                measured.omega = control.outputs(n + j)[1];
            }
            if self.long.joint_settling(j) {
                measured.flags |= measured_flags::SETTLING;
            }
            if !reader.has_velocities() {
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
