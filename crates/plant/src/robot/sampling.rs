//! Sampling of the robot's sensors, at SYNC or by their own clocks.

use super::SimRobot;
use crate::clock::Instant;
use crate::drive::DriveReading;
use crate::readings::{Sent, six};
use robot_config::slots::Source;
use robot_state::Wrench;

impl SimRobot {
    /// Samples the sensors that answer SYNC.
    pub(crate) fn sample(&mut self, time: f64) {
        for j in 0..self.order.len() {
            if self.clocks.joints[j].at_sync() {
                self.sense_joint(j, self.clocks.joints[j].latency() / self.dt);
            }
        }
        for s in 0..self.ft.len() {
            if self.clocks.ft[s].at_sync() {
                self.sense_ft(s, self.clocks.ft[s].latency() / self.dt, time);
            }
        }
        for i in 0..self.imus.len() {
            if self.clocks.imus[i].at_sync() {
                self.sense_imu(i, self.clocks.imus[i].latency() / self.dt);
            }
        }
    }

    /// Samples the sensors whose own clocks are due.
    pub(crate) fn sample_own(&mut self, time: f64) {
        let (now, dt) = (self.time(), self.dt);
        for j in 0..self.order.len() {
            while let Some(Instant { measured, stamp }) = self.clocks.joints[j].due(now) {
                let r = self.sense_joint(j, (now - measured) / dt);
                let values = [r.theta, r.q, r.current, r.omega, f64::from(r.status), 0.0];
                self.send(Source::Joint(j), stamp, values);
            }
        }
        for s in 0..self.ft.len() {
            while let Some(Instant { measured, stamp }) = self.clocks.ft[s].due(now) {
                let Wrench { force, torque } = self.sense_ft(s, (now - measured) / dt, time);
                self.send(Source::Ft(s), stamp, six(force, torque));
            }
        }
        for i in 0..self.imus.len() {
            while let Some(Instant { measured, stamp }) = self.clocks.imus[i].due(now) {
                let values = self.sense_imu(i, (now - measured) / dt);
                self.send(Source::Imu(i), stamp, values);
            }
        }
    }

    fn send(&mut self, source: Source, stamp: f64, values: [f64; 6]) {
        self.readings.sent.push(Sent {
            source,
            stamp,
            values,
        });
    }

    fn sense_joint(&mut self, j: usize, ago: f64) -> DriveReading {
        let reading = self.joints[self.order[j]].sense(ago, self.dt);
        self.readings.joints[j] = reading;
        reading
    }

    fn sense_ft(&mut self, s: usize, ago: f64, time: f64) -> Wrench {
        self.readings.ft_temperature[s] = self.ft[s].temperature(time);
        self.readings.ft[s] = self.ft[s].sense(ago, time);
        self.readings.ft[s]
    }

    fn sense_imu(&mut self, i: usize, ago: f64) -> [f64; 6] {
        let (gyro, accelerometer) = self.imus[i].sense(ago);
        self.readings.imus[i] = six(gyro, accelerometer);
        self.readings.imus[i]
    }
}
