//! A gear's past before its log begins.

use super::torsion;
use crate::record::Record;
use estimators::hysteresis::{Gear, GearParameters};
use estimators::kinematic_error::KinematicErrorParameters;

/// Torque by an unknown past that counts as none, of the largest there can be.
const FADED: f64 = 0.1;
/// Least share of a log's samples on which a gear can be judged by itself.
const ENOUGH: f64 = 0.2;

/// Root mean square of the gear's stiffness over the samples that may be fitted to, N·m/rad: errors of the
/// torsion appear in the torque by it, in a gear that stiffens by far more than by the linear part.
#[must_use]
pub fn typical_stiffness(
    record: &Record,
    error: &KinematicErrorParameters,
    gear: &GearParameters,
) -> f64 {
    let torsion = record.smooth(&torsion(record, error), 0);
    let squares = (record.spread(usize::MAX)).map(|i| gear.stiffness(torsion[i]).powi(2));
    let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    if count > 0.0 {
        f64::sqrt(sum / count)
    } else {
        gear.linear
    }
}

/// Samples at which the springs' past before the log no longer counts; all where that is hardly ever so.
#[must_use]
pub fn known(
    record: &Record,
    error: &KinematicErrorParameters,
    gear: &GearParameters,
) -> Vec<bool> {
    let torsion = record.smooth(&torsion(record, error), 0);
    let size = |gear: &Gear| {
        let [gear, bearing] = gear.unknown();
        gear.hypot(bearing)
    };
    let mut gear = Gear::new(gear.clone(), record.sample_period);
    let mut bound = 0.0;
    let known: Vec<bool> = (torsion.iter().zip(&record.samples).enumerate())
        .map(|(i, (x, sample))| {
            let begins = record.log_begins().binary_search(&i).is_ok();
            if begins {
                gear.reset();
                bound = FADED * size(&gear);
            }
            gear.update(*x);
            gear.bearing(sample.q, record.motion[i][0]);
            size(&gear) <= bound
        })
        .collect();
    let count = known.iter().filter(|known| **known).count() as f64;
    if count < ENOUGH * known.len() as f64 {
        vec![true; known.len()]
    } else {
        known
    }
}
