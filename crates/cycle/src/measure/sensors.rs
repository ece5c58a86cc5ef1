//! Sensors: F/T sensors and IMUs, from their frames to the axes of the filters.

use robot_config::{Parameters, slots};
use robot_state::{
    Event, FtMeasured, MAX_FURTHER_IMUS, MeasuredRecord, Settings, Wrench, measured_flags,
};

use super::Measure;
use super::filtered::AXES;
use super::imu_check::ImuCheck;
use super::reception::{Reception, Source, note_unsound};
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

    pub(super) fn read_imus(
        &mut self,
        at: Instants,
        holds: bool,
        measured: &mut MeasuredRecord,
        counts: &mut Counts,
    ) {
        let dt = self.sample_period * f64::from(self.skipped + 1);
        let [alone, alone_before] = self.imus.is_alone();
        let of_record = std::iter::once(&mut measured.imu).chain(&mut measured.further_imus);
        let sources = self.imu_sources.iter_mut().zip(of_record).enumerate();
        for (i, ((source, check), imu)) in sources {
            let before = source.last_used();
            let mut reading = (self.reception).reading(source, at, counts);
            let slot = |slot: usize| self.reception.slot(slot);
            let gyro: [f64; 3] = std::array::from_fn(|axis| slot(slots::gyro(i, axis)));
            let acceleration = std::array::from_fn(|axis| slot(slots::accelerometer(i, axis)));
            if !reading.usable {
                check.wait(dt);
            } else if !check.is_plausible(gyro, acceleration, dt, holds) {
                reading = self.reception.reject(source, before, at, &reading);
            }
            // Signals that depend on the first one alone are an event of their own where another stands in for it.
            let counts_alone = i == 0 && alone;
            if counts_alone {
                let before = if alone_before { imu.flags } else { 0 };
                note_unsound(before, &reading, Subject::Imu(i), counts);
            }
            imu.age_s = reading.age_s;
            imu.flags = reading.flags;
            if reading.usable {
                (imu.gyro, imu.accelerometer) = (gyro, acceleration);
                let first = AXES * (self.sensors.len() + i);
                self.axes[first..][..3].copy_from_slice(&imu.gyro);
                self.axes[first + 3..][..3].copy_from_slice(&imu.accelerometer);
            } else if counts_alone {
                counts.add_of(Event::SensorMissed, Subject::Imu(i));
            }
        }
    }

    /// Compares the IMUs; where another one stands in for the first, the signals of the base are its.
    pub(super) fn compare_imus(
        &mut self,
        holds: bool,
        measured: &mut MeasuredRecord,
        counts: &mut Counts,
    ) {
        let dt = self.sample_period * f64::from(self.skipped + 1);
        let mut flags = [measured.imu.flags; 1 + MAX_FURTHER_IMUS];
        for (flags, imu) in flags.iter_mut().skip(1).zip(&measured.further_imus) {
            *flags = imu.flags;
        }
        self.imus.stand_in(&mut self.long);
        self.imus.update(flags, &self.long, dt, counts);
        if self.imus.is_doubted(holds, dt) {
            let before = std::mem::replace(&mut self.imu_doubted, true);
            // An IMU that is silent is reported as that.
            if measured.imu.flags & measured_flags::STALE == 0 {
                counts.lasting(Event::SensorStale, Subject::Imu(0), !before);
            }
            measured.imu.flags |= measured_flags::STALE;
        } else {
            self.imu_doubted = false;
        }
        self.imus.stand_in(&mut self.short);
        if let Some(contact) = &mut self.contact {
            self.imus.stand_in(contact);
        }
    }

    /// Filtered motion of every IMU, and of the base.
    pub(super) fn publish_imus(&self, measured: &mut MeasuredRecord) {
        let base = self.long.input().imu;
        let of_record = std::iter::once(&mut measured.imu).chain(&mut measured.further_imus);
        for (i, (motion, imu)) in self.long.imus().iter().zip(of_record).enumerate() {
            let motion = if i == 0 { &base } else { motion };
            imu.gyro_hat = motion.angular_velocity.into();
            imu.accelerometer_hat = motion.proper_acceleration.into();
            imu.angular_acceleration_hat = motion.angular_acceleration.into();
            if self.long.imu_settling(i) {
                imu.flags |= measured_flags::SETTLING;
            }
        }
        let stand_in = self
            .imus
            .standing_in()
            .and_then(|index| index.checked_sub(1));
        if let Some(other) = stand_in.and_then(|place| measured.further_imus.get(place)) {
            let (age_s, flags) = (other.age_s, other.flags);
            let imu = &mut measured.imu;
            (imu.gyro, imu.accelerometer) = (imu.gyro_hat, imu.accelerometer_hat);
            (imu.age_s, imu.flags) = (age_s, flags | measured_flags::STANDS_IN);
        }
    }
}

/// The messages and signals of every F/T sensor.
pub(super) fn of_ft_sensors(parameters: &Parameters, reception: &Reception) -> Vec<Source> {
    let sensors = parameters.ft_sensors.iter().enumerate();
    sensors
        .map(|(s, ft)| {
            let temperature = ft.has_temperature.then(|| slots::ft_temperature(s));
            let axes = (0..AXES).map(|axis| slots::ft(s, axis));
            let slots = axes.chain(temperature).collect();
            reception.source(slots, ft.sampling, &ft.signals, true)
        })
        .collect()
}

/// Signals of every IMU, and the check of its values.
pub(super) fn of_imus(parameters: &Parameters, reception: &Reception) -> Vec<(Source, ImuCheck)> {
    let period = parameters.timing.sample_period;
    let imus = parameters.imus.iter().enumerate();
    imus.map(|(i, imu)| {
        let gyro = (0..3).map(|axis| slots::gyro(i, axis));
        let axes = gyro.chain((0..3).map(|axis| slots::accelerometer(i, axis)));
        let source = reception.source(axes.collect(), imu.sampling, &imu.signals, true);
        (source, ImuCheck::new(imu.sampling.longest_gap(period)))
    })
    .collect()
}
