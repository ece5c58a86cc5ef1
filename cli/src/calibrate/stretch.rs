//! Stretches of a recorded run: cycles without a gap, as columns that lie on the disk.

use crate::reference::torques::Signals;
use crate::spool::{Column, Spool};
use problem::Problem;
use robot_config::Robot;
use robot_state::torque_flags::VALID;
use robot_state::{CycleRecord, measured_flags};
use std::sync::Arc;

/// Samples with one of these are not fitted to.
const NOT_USED: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::STALE
    | measured_flags::JUMP
    | measured_flags::IMPLAUSIBLE;

/// Cycles without a gap, with one contact set and one tare.
pub(crate) struct Stretch {
    pub(crate) signals: Signals,
    /// Index of the contact set.
    pub(crate) contact_set: usize,
    /// Offsets that were subtracted from the F/T sensors' readings, by sensor.
    pub(crate) offsets: Vec<[f64; 6]>,
    /// By joint, in config order.
    pub(crate) drives: Vec<Drive>,
}

/// Raw samples of one joint beside [`Signals::angles`].
pub(crate) struct Drive {
    /// theta, rad.
    pub(crate) theta: Column,
    /// i, A.
    pub(crate) current: Column,
    /// 1 where the sample was measured, not bridged, and the drive was on: of one that is off a brake may carry the
    /// torque. Else 0.
    pub(crate) used: Column,
    /// Torque from encoders and current as published, and its standard deviation, N·m; NaN where it was not
    /// valid.
    pub(crate) torque: [Column; 2],
}

impl Drive {
    pub(crate) fn new(spool: &Arc<Spool>) -> Self {
        let column = || Column::new(spool);
        Self {
            theta: column(),
            current: column(),
            used: column(),
            torque: [column(), column()],
        }
    }
}

impl Stretch {
    /// Without a cycle yet; contact set and tare are those of a record.
    pub(super) fn new(
        spool: &Arc<Spool>,
        robot: &Robot,
        period: f64,
        record: &CycleRecord,
    ) -> Self {
        let p = &robot.parameters;
        let n = p.joints.len();
        let sensors = record.measured.ft.iter().take(p.ft_sensors.len());
        let column = || Column::new(spool);
        let six = || std::array::from_fn(|_| column());
        Self {
            signals: Signals {
                t: column(),
                period,
                angles: (0..n).map(|_| column()).collect(),
                ft: p.ft_sensors.iter().map(|_| six()).collect(),
                imu: p.imus.first().map(|_| six()),
                file: String::new(),
            },
            contact_set: record.estimated.contact_set as usize,
            offsets: sensors.map(|ft| ft.offset.to_array()).collect(),
            drives: (0..n).map(|_| Drive::new(spool)).collect(),
        }
    }

    pub(super) fn seconds(&self) -> f64 {
        self.signals.t.len() as f64 * self.signals.period
    }

    /// Takes a cycle; `off`: cycles until each joint's current counts.
    ///
    /// # Errors
    /// A disk that is full.
    pub(super) fn push(
        &mut self,
        t: f64,
        record: &CycleRecord,
        off: &[u32],
    ) -> Result<(), Problem> {
        let signals = &mut self.signals;
        signals.t.push(t)?;
        let joints = record.measured.joints.iter();
        let joints = joints.zip(&record.estimated.joints).zip(off);
        let mut own = signals.angles.iter_mut().zip(&mut self.drives);
        for ((angle, drive), ((joint, estimated), off)) in own.by_ref().zip(joints) {
            angle.push(joint.q)?;
            drive.theta.push(joint.theta)?;
            drive.current.push(joint.current)?;
            let used = joint.flags & NOT_USED == 0 && *off == 0;
            drive.used.push(f64::from(u8::from(used)))?;
            let torque = &estimated.tau_encoder;
            let torque = match torque.flags & VALID {
                0 => [f64::NAN; 2],
                _ => [torque.tau, torque.sigma],
            };
            push_each(&mut drive.torque, torque)?;
        }
        for (axes, sensor) in signals.ft.iter_mut().zip(&record.measured.ft) {
            push_each(axes, sensor.wrench.to_array())?;
        }
        if let Some(axes) = &mut signals.imu {
            let imu = &record.measured.imu;
            let ([a, b, c], [d, e, f]) = (imu.gyro, imu.accelerometer);
            push_each(axes, [a, b, c, d, e, f])?;
        }
        Ok(())
    }

    /// Leaves out both ends.
    ///
    /// # Errors
    /// A disk that is full.
    pub(super) fn cut(&mut self, margin: usize) -> Result<(), Problem> {
        let count = self.signals.t.len();
        let kept = margin.min(count)..count.saturating_sub(margin).max(margin.min(count));
        let Signals {
            t, angles, ft, imu, ..
        } = &mut self.signals;
        let drives = self.drives.iter_mut().flat_map(|drive| {
            let of_drive = [&mut drive.theta, &mut drive.current, &mut drive.used];
            of_drive.into_iter().chain(&mut drive.torque)
        });
        let sensors = ft.iter_mut().flatten().chain(imu.iter_mut().flatten());
        let mut all = [t].into_iter().chain(angles).chain(sensors).chain(drives);
        all.try_for_each(|column| column.cut(kept.clone()))
    }
}

/// Adds a value to each column.
fn push_each<const N: usize>(columns: &mut [Column; N], values: [f64; N]) -> Result<(), Problem> {
    let mut both = columns.iter_mut().zip(values);
    both.try_for_each(|(column, value)| column.push(value))
}
