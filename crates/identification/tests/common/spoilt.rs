//! Ways to spoil a log: shifts, filters, bad samples, kept readings, wraps.

use crate::other_joint::OtherJoint;
use identification::log::LogRow;
use test_support::Random;

/// A log, its joint, and where and how much a defect is.
pub(crate) struct Case<'a> {
    /// The joint.
    pub(crate) joint: &'a OtherJoint,
    /// Its log.
    pub(crate) rows: Vec<LogRow>,
    /// Where and how much.
    pub(crate) random: &'a mut Random,
}

/// One column.
pub(crate) type Get = fn(&mut LogRow) -> &mut f64;
pub(crate) const THETA: Get = |r| &mut r.theta;
pub(crate) const Q: Get = |r| &mut r.q;
pub(crate) const I: Get = |r| &mut r.current;
pub(crate) const TAU_SENSOR: Get = |r| &mut r.tau_sensor;

impl Case<'_> {
    pub(crate) fn each(&mut self, change: impl Fn(&mut LogRow)) {
        self.rows.iter_mut().for_each(change);
    }

    pub(crate) fn column(&mut self, get: Get) -> Vec<f64> {
        self.rows.iter_mut().map(|r| *get(r)).collect()
    }

    pub(crate) fn set(&mut self, get: Get, values: impl IntoIterator<Item = f64>) {
        for (row, x) in self.rows.iter_mut().zip(values) {
            *get(row) = x;
        }
    }

    pub(crate) fn span(&mut self, get: Get) -> f64 {
        let x = self.column(get);
        let low = x.iter().copied().fold(f64::INFINITY, f64::min);
        x.iter().copied().fold(f64::NEG_INFINITY, f64::max) - low
    }

    /// RMS about the mean.
    pub(crate) fn deviation(&mut self, get: Get) -> f64 {
        let x = self.column(get);
        let n = x.len() as f64;
        let mean = x.iter().sum::<f64>() / n;
        (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt()
    }

    /// A column `late` seconds later.
    pub(crate) fn delay(&mut self, get: Get, late: f64) {
        let shift = (late * self.joint.rate).round() as i64;
        let x = self.column(get);
        let last = x.len() as i64 - 1;
        let at = |k: usize| x[(k as i64 - shift).clamp(0, last) as usize];
        self.set(get, (0..x.len()).map(at).collect::<Vec<f64>>());
    }

    /// A low-pass of first order.
    pub(crate) fn low_pass(&mut self, get: Get, time: f64) {
        let pole = (-1.0 / (time * self.joint.rate)).exp();
        let x = self.column(get);
        let mut state = x[0];
        let y = x.iter().map(|x| {
            state = pole * state + (1.0 - pole) * x;
            state
        });
        self.set(get, y.collect::<Vec<f64>>());
    }

    /// Some rows, apart from one another, set to what `value` gives.
    pub(crate) fn spoil(&mut self, get: Get, count: usize, value: impl Fn(f64) -> f64) {
        for _ in 0..count {
            let row = 10 + self.random.below(self.rows.len() - 20);
            let x = get(&mut self.rows[row]);
            *x = value(*x);
        }
    }

    /// Keeps a reading for some seconds in which it would have moved by a fifth of its range.
    pub(crate) fn freeze(&mut self, get: Get) {
        let (x, span) = (self.column(get), self.span(get));
        let length = ((1.0 + 3.0 * self.random.unit()) * self.joint.rate) as usize;
        for _ in 0..200 {
            let start = self.random.below(x.len() - length - 1);
            let part = &x[start..start + length];
            let moved = part
                .iter()
                .map(|y| (y - x[start]).abs())
                .fold(0.0, f64::max);
            if moved > 0.2 * span {
                let held = std::iter::repeat_n(x[start], length);
                let held: Vec<f64> = held.collect();
                for (row, x) in self.rows[start..].iter_mut().zip(held) {
                    *get(row) = x;
                }
                return;
            }
        }
    }

    pub(crate) fn wrap(&mut self, get: Get, range: f64) {
        let x = self.column(get);
        self.set(
            get,
            x.iter()
                .map(|x| x - range * (x / range).round())
                .collect::<Vec<f64>>(),
        );
    }
}
