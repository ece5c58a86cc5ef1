//! Numbers of `sim.toml`: checked, and converted to SI units while they are read.

use crate::kinematic_error::KinematicError;
use problem::{Problem, line_at};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;

/// The problem of a key, with file and line.
pub(super) fn locate(text: &str, file: &str, error: &toml::de::Error) -> Problem {
    let problem = Problem::new(error.message(), "");
    let Some(span) = error.span() else {
        return problem.at(file, 0);
    };
    let line = line_at(text, span.start);
    let key = text.lines().nth(line - 1).and_then(|l| l.split_once('='));
    let problem = match key {
        Some((key, _)) => problem.of(key.trim()),
        None => problem,
    };
    problem.at(file, line)
}

type Read<T, E> = Result<T, E>;

fn checked<'de, D: Deserializer<'de>>(
    deserializer: D,
    allowed: &str,
    good: impl Fn(f64) -> bool,
) -> Read<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    if value.is_finite() && good(value) {
        Ok(value)
    } else {
        Err(serde::de::Error::custom(format!(
            "{value} is not allowed; allowed: {allowed}"
        )))
    }
}

pub(super) fn finite<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    checked(d, "a finite number", |_| true)
}

pub(super) fn positive<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    checked(d, "a finite number > 0", |x| x > 0.0)
}

pub(super) fn non_negative<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    checked(d, "a finite number >= 0", |x| x >= 0.0)
}

pub(super) fn at_least_one<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    checked(d, "a finite number >= 1", |x| x >= 1.0)
}

pub(super) fn fraction<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    checked(d, "a number from 0 to 1", |x| (0.0..=1.0).contains(&x))
}

pub(super) fn per_cent<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    Ok(0.01 * checked(d, "a number from 0 to 50", |x| (0.0..=50.0).contains(&x))?)
}

pub(super) fn micro<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    Ok(1e-6 * positive(d)?)
}

pub(super) fn micro0<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    Ok(1e-6 * checked(d, "a number from 0 to 10000", |x| (0.0..=1e4).contains(&x))?)
}

pub(super) fn optional_micro0<'de, D: Deserializer<'de>>(d: D) -> Read<Option<f64>, D::Error> {
    Ok(Some(micro0(d)?))
}

pub(super) fn optional_micro<'de, D: Deserializer<'de>>(d: D) -> Read<Option<f64>, D::Error> {
    let allowed = "a number from 10 to 16000";
    Ok(Some(
        1e-6 * checked(d, allowed, |x| (10.0..=16e3).contains(&x))?,
    ))
}

pub(super) fn milli0<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    Ok(1e-3 * checked(d, "a number from 0 to 10000", |x| (0.0..=1e4).contains(&x))?)
}

pub(super) fn optional_milli<'de, D: Deserializer<'de>>(d: D) -> Read<Option<f64>, D::Error> {
    Ok(Some(
        1e-3 * checked(d, "a number from 1 to 10000", |x| (1.0..=1e4).contains(&x))?,
    ))
}

pub(super) fn per_million<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    Ok(1e-6 * checked(d, "a number from 0 to 20000", |x| (0.0..=2e4).contains(&x))?)
}

pub(super) fn degrees<'de, D: Deserializer<'de>>(d: D) -> Read<f64, D::Error> {
    Ok(non_negative(d)?.to_radians())
}

/// A number that must be finite.
#[derive(Deserialize)]
struct Finite(#[serde(deserialize_with = "finite")] f64);

pub(super) fn finite3<'de, D: Deserializer<'de>>(d: D) -> Read<[f64; 3], D::Error> {
    Ok(<[Finite; 3]>::deserialize(d)?.map(|x| x.0))
}

pub(super) fn degrees3<'de, D: Deserializer<'de>>(d: D) -> Read<[f64; 3], D::Error> {
    Ok(finite3(d)?.map(f64::to_radians))
}

pub(super) fn degrees_map<'de, D: Deserializer<'de>>(
    d: D,
) -> Read<BTreeMap<String, f64>, D::Error> {
    let map = BTreeMap::<String, Finite>::deserialize(d)?;
    Ok((map.into_iter())
        .map(|(name, x)| (name, x.0.to_radians()))
        .collect())
}

pub(super) fn milli_map<'de, D: Deserializer<'de>>(d: D) -> Read<BTreeMap<String, f64>, D::Error> {
    let map = BTreeMap::<String, Finite>::deserialize(d)?;
    Ok((map.into_iter())
        .map(|(name, x)| (name, 1e-3 * x.0))
        .collect())
}

pub(super) fn degree_pairs<'de, D: Deserializer<'de>>(d: D) -> Read<Vec<[f64; 2]>, D::Error> {
    let pairs = Vec::<[Finite; 2]>::deserialize(d)?;
    Ok((pairs.into_iter())
        .map(|p| p.map(|x| x.0.to_radians()))
        .collect())
}

/// `[drive.NAME.kinematic_error]`: cos and sin of harmonic 1, 2, … of q and of theta.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct KinematicErrorSection {
    #[serde(default, rename = "link_deg", deserialize_with = "degree_pairs")]
    link: Vec<[f64; 2]>,
    #[serde(default, rename = "motor_deg", deserialize_with = "degree_pairs")]
    motor: Vec<[f64; 2]>,
}

pub(super) fn kinematic_error<'de, D: Deserializer<'de>>(d: D) -> Read<KinematicError, D::Error> {
    let section = KinematicErrorSection::deserialize(d)?;
    Ok(KinematicError {
        constant: 0.0,
        link: section.link,
        link_frequency: 1.0,
        motor: section.motor,
        motor_frequency: 1.0,
    })
}

pub(super) fn one() -> f64 {
    1.0
}

pub(super) fn hundredth() -> f64 {
    0.01
}

pub(super) fn tenth_of_a_millirad() -> f64 {
    1e-4
}

pub(super) fn sixteen_bits() -> f64 {
    65536.0
}
