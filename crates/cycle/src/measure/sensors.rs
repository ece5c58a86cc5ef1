//! Sensors: F/T sensors and IMU, from their frames to the axes of the filters.

use robot_config::slots;
use robot_state::{Event, FtMeasured, MeasuredRecord, Settings, Wrench};

use super::Measure;
use super::filtered::AXES;
use super::reception::note_unsound;
use crate::events::{Counts, Subject};
use crate::time::Instants;

impl Measure {
    /// Offsets of F/T sensors move towards those of the last tare. A tare is only taken over while
    /// the robot holds: it was found at rest, and a mode that is active keeps what it began with.
    pub(super) fn take_offsets(&mut self, settings: Option<&Settings>, holds: bool) {
        let (period_s, inputs) = (self.sample_period, &mut self.ft_inputs);
        for (s, input) in inputs.iter_mut().enumerate() {
            let tare = settings.map_or(Wrench::default(), |settings| settings.ft_offset[s]);
            let tare = if holds { tare } else { input.target() };
            input.follow(&tare, period_s);
        }
    }

    pub(super) fn read_ft_sensors(
        &mut self,
        at: Instants,
        ft: &mut [FtMeasured],
        counts: &mut Counts,
    ) {
        self.axes.fill(f64::NAN);
        for (s, sensor) in ft.iter_mut().enumerate().take(self.sensors.len()) {
            let reading = (self.reception).reading(&mut self.sensors[s], at, counts);
            note_unsound(sensor.flags, &reading, Subject::FtSensor(s), counts);
            sensor.age_s = reading.age_s;
            sensor.flags = reading.flags;
            let input = &mut self.ft_inputs[s];
            sensor.offset = input.offset();
            if reading.usable {
                let slot = |slot: usize| self.reception.slot(slot);
                let raw: [f64; AXES] = std::array::from_fn(|axis| slot(slots::ft(s, axis)));
                sensor.temperature = slot(slots::ft_temperature(s));
                sensor.wrench = input.wrench(&raw, sensor.temperature);
                self.axes[AXES * s..][..AXES].copy_from_slice(&sensor.wrench.to_array());
            } else {
                counts.add_of(Event::SensorMissed, Subject::FtSensor(s));
            }
        }
    }

    pub(super) fn read_imu(
        &mut self,
        at: Instants,
        holds: bool,
        measured: &mut MeasuredRecord,
        counts: &mut Counts,
    ) {
        let Some((source, check)) = &mut self.imu else {
            return;
        };
        let before = source.last_used();
        let mut reading = (self.reception).reading(source, at, counts);
        let slot = |slot: usize| self.reception.slot(slot);
        let gyro: [f64; 3] = std::array::from_fn(|axis| slot(slots::gyro(axis)));
        let acceleration = std::array::from_fn(|axis| slot(slots::accelerometer(axis)));
        let dt = self.sample_period * f64::from(self.skipped + 1);
        if !reading.usable {
            check.wait(dt);
        } else if !check.is_plausible(gyro, acceleration, dt, holds) {
            reading = self.reception.reject(source, before, at, &reading);
        }
        let imu = &mut measured.imu;
        note_unsound(imu.flags, &reading, Subject::Imu, counts);
        imu.age_s = reading.age_s;
        imu.flags = reading.flags;
        if reading.usable {
            (imu.gyro, imu.accelerometer) = (gyro, acceleration);
            let first = AXES * self.sensors.len();
            self.axes[first..][..3].copy_from_slice(&imu.gyro);
            self.axes[first + 3..][..3].copy_from_slice(&imu.accelerometer);
        } else {
            counts.add_of(Event::SensorMissed, Subject::Imu);
        }
    }
}
