//! Columns with stamps of their own on one even grid, without delay.

use super::map::Map;
use inspection::{Channel, Finding, Quantity};
use problem::Problem;

/// Part of a turn between two samples, from which its direction is not sure.
const MAX_MOVED: f64 = 0.4;

/// Part of a period by which the grid may reach beyond a column's last stamp.
const BEYOND: f64 = 0.1;

/// One signal with its stamps.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    /// t, s, increasing.
    pub(super) t: Vec<f64>,
    /// Values.
    pub(super) values: Vec<f64>,
}

impl Column {
    /// The same in another unit.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        self.values.iter_mut().for_each(|x| *x *= factor);
        self
    }

    /// Removes steps of whole turns.
    ///
    /// # Errors
    /// The time of two samples between which the number of turns cannot be known.
    pub(super) fn unwrap(&mut self, turn: f64, max_gap: f64) -> Result<(), f64> {
        let (mut turns, mut rate) = (0.0, 0.0f64);
        for i in 1..self.values.len() {
            let step = self.values[i] + turns * turn - self.values[i - 1];
            let back = (step / turn).round();
            let (moved, time) = (step / turn - back, self.t[i] - self.t[i - 1]);
            let unknown_gap = time > max_gap && (rate * time).abs() > MAX_MOVED;
            if moved.abs() > MAX_MOVED || unknown_gap {
                return Err(self.t[i]);
            }
            turns -= back;
            rate = moved / time;
            self.values[i] += turns * turn;
        }
        Ok(())
    }

    /// Inspects the column, mends it and leaves out what is no measurement. The end of its name says which quantity it is.
    pub(super) fn inspect(&mut self, name: &str) -> Vec<Finding> {
        let quantity = match name.rsplit('.').next() {
            Some("q") => Quantity::Angle,
            Some("theta") => Quantity::Way,
            _ => Quantity::Effort,
        };
        let channel = Channel {
            name,
            quantity,
            values: &self.values,
        };
        let found = inspection::inspect(&self.t, channel);
        self.values = found.values;
        let lost = found.lost;
        let mut rows = 0..;
        let mut kept = |_: &f64| {
            rows.next()
                .is_some_and(|row| lost.binary_search(&row).is_err())
        };
        self.t.retain(&mut kept);
        rows = 0..;
        let mut kept = |_: &f64| {
            rows.next()
                .is_some_and(|row| lost.binary_search(&row).is_err())
        };
        self.values.retain(&mut kept);
        found.findings
    }

    /// Time from the first to the last stamp, s.
    pub(super) fn duration(&self) -> Option<f64> {
        Some(self.t.last()? - self.t.first()?)
    }

    /// Step between stamps, median, s.
    pub(super) fn step(&self) -> f64 {
        let mut steps: Vec<f64> = self.t.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Even stamps that all columns cover.
pub(super) struct Grid {
    start: f64,
    period: f64,
    count: usize,
    max_gap: f64,
}

impl Grid {
    /// The grid of the columns' common time.
    ///
    /// # Errors
    /// Columns without common time.
    pub(super) fn new<'a>(
        map: &Map,
        columns: impl Iterator<Item = &'a Column> + Clone,
        log: &str,
    ) -> Result<Self, Problem> {
        let first = columns.clone().filter_map(|c| c.t.first());
        let last = columns.filter_map(|c| c.t.last());
        let start = first.fold(f64::MIN, |m, t| m.max(*t));
        let end = last.fold(f64::MAX, |m, t| m.min(*t));
        let period = 1.0 / map.sample_rate;
        // Stamps of topics that begin a little apart cost no row.
        let count = ((end - start) / period + BEYOND).floor() + 1.0;
        const MAX_ROWS: f64 = 1e8;
        if !(2.0..MAX_ROWS).contains(&count) {
            let reason = if end < start {
                format!(
                    "the columns have no common time: one ends {:.3} s before another begins: stamps of two clocks?",
                    start - end
                )
            } else {
                format!(
                    "the columns' common time is {:.6} s: unit of the stamps?",
                    end - start
                )
            };
            let allowed = format!("2 to {MAX_ROWS:.0} periods of {period} s");
            return Err(Problem::new(reason, allowed).at(log, 0));
        }
        Ok(Self {
            start,
            period,
            count: count as usize,
            max_gap: map.max_gap(),
        })
    }

    /// The stamps, from zero, s.
    pub(super) fn stamps(&self) -> impl Iterator<Item = f64> + '_ {
        // Rounded to nanoseconds, which print short.
        (0..self.count).map(|k| (k as f64 * self.period * 1e9).round() / 1e9)
    }

    /// A column's values at the stamps; NaN in gaps. Of several samples in a period the line of
    /// least squares through those about each stamp, otherwise the line between two samples.
    pub(super) fn resample(&self, column: &Column) -> Vec<f64> {
        let averages = column.step() < 0.6 * self.period;
        let (t, x) = (&column.t, &column.values);
        let mut at = 0;
        let mut value = |k: usize| {
            let now = self.start + k as f64 * self.period;
            while at + 1 < t.len() && t[at + 1] <= now {
                at += 1;
            }
            if averages {
                return line_about(t, x, at, now, 0.5 * self.period);
            }
            let Some(next) = t.get(at + 1) else {
                let before = at.checked_sub(1).filter(|k| t[at] - t[*k] <= self.max_gap);
                let slope = before.map_or(0.0, |k| (x[at] - x[k]) / (t[at] - t[k]));
                return if now - t[at] < 0.5 * self.period {
                    x[at] + slope * (now - t[at])
                } else {
                    f64::NAN
                };
            };
            if next - t[at] > self.max_gap {
                return if now == t[at] { x[at] } else { f64::NAN };
            }
            x[at] + (x[at + 1] - x[at]) * (now - t[at]) / (next - t[at])
        };
        (0..self.count).map(&mut value).collect()
    }
}

/// The straight line of least squares through the samples within `half` of `now`, at `now`; `at` is
/// the last sample not after it.
fn line_about(t: &[f64], x: &[f64], at: usize, now: f64, half: f64) -> f64 {
    let after = (at + 1..t.len()).take_while(|&i| t[i] <= now + half);
    let before = (0..=at).rev().take_while(|&i| t[i] >= now - half);
    let near: Vec<(f64, f64)> = before.chain(after).map(|i| (t[i] - now, x[i])).collect();
    let count = near.len() as f64;
    let mean = |value: &dyn Fn(&(f64, f64)) -> f64| near.iter().map(value).sum::<f64>() / count;
    let (time, value) = (mean(&|p| p.0), mean(&|p| p.1));
    let spread = mean(&|p| (p.0 - time).powi(2));
    // At an end or a gap all samples lie to one side.
    if near.is_empty() || time.abs() > 0.5 * half {
        return f64::NAN;
    }
    if spread == 0.0 {
        return value;
    }
    value - time * mean(&|p| (p.0 - time) * (p.1 - value)) / spread
}

#[cfg(test)]
mod tests {
    use super::{Column, Grid};

    fn grid(period: f64, count: usize) -> Grid {
        Grid {
            start: 0.0,
            period,
            count,
            max_gap: 5.0 * period,
        }
    }

    #[test]
    fn a_straight_line_stays_one_at_any_stamps() {
        let line = |t: f64| 3.0 - 2.0 * t;
        for (period, jitter) in [(4e-3, 1.3e-3), (1e-3, 0.2e-3), (2e-2, 1e-3)] {
            let t: Vec<f64> = (0..500)
                .map(|i| 4e-3 * f64::from(i) + jitter * f64::from(i * i % 7) / 7.0)
                .collect();
            let values = t.iter().map(|t| line(*t)).collect();
            let grid = grid(period, (1.9 / period) as usize);
            let out = grid.resample(&Column { t, values });
            for (now, x) in grid.stamps().zip(out).skip(1) {
                assert!((x - line(now)).abs() < 1e-9, "{period}: {now} {x}");
            }
        }
    }

    #[test]
    fn gaps_are_left_out() {
        let mut t: Vec<f64> = (0..100).map(|i| 1e-3 * f64::from(i)).collect();
        t.drain(40..60);
        let values = t.clone();
        let out = grid(1e-3, 90).resample(&Column { t, values });
        assert!(out[45..58].iter().all(|x| x.is_nan()));
        assert!(out[..39].iter().chain(&out[61..]).all(|x| x.is_finite()));
    }

    #[test]
    fn turns_are_unwrapped() {
        let values = (0..400).map(|i| (7 * i) as f64 % 360.0 - 180.0).collect();
        let t = (0..400).map(f64::from).collect();
        let mut column = Column { t, values };
        column.unwrap(360.0, 5.0).unwrap();
        for (i, x) in column.values.iter().enumerate() {
            assert!((x - (7 * i) as f64 + 180.0).abs() < 1e-9, "{i} {x}");
        }
    }

    #[test]
    fn turns_that_cannot_be_known_are_an_error() {
        let values = (0..400).map(|i| (170 * i) as f64 % 360.0).collect();
        let t: Vec<f64> = (0..400).map(f64::from).collect();
        assert!(
            Column {
                t: t.clone(),
                values
            }
            .unwrap(360.0, 5.0)
            .is_err()
        );
        let values = (0..400).map(|i| (7 * i) as f64 % 360.0).collect();
        let mut column = Column { t, values };
        column.t.drain(100..140);
        column.values.drain(100..140);
        assert_eq!(column.unwrap(360.0, 5.0), Err(140.0));
    }
}
