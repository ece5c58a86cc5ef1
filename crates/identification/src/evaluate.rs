//! Errors of a torque estimate against a sensor: figures gathered in constant memory.

use std::collections::VecDeque;

/// Lags at which the error is measured, samples: the delay of an estimate is less.
const LAGS: usize = 64;

/// Errors of one estimator, sample by sample.
#[derive(Debug, Clone)]
pub struct Score {
    sample_period: f64,
    count: f64,
    max: f64,
    square: f64,
    /// Sums for the correlation: x, y, xx, yy, xy.
    sums: [f64; 5],
    /// The sensor's last values, newest first.
    sensor: VecDeque<f64>,
    /// Sum of squares of the estimate against the sensor as many samples ago.
    lagged: [f64; LAGS],
    lagged_count: f64,
}

/// Figures of the errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Largest error, N·m.
    pub max: f64,
    /// Root mean square of the error, N·m.
    pub rms: f64,
    /// `rms` in percent of the root mean square torque.
    pub rms_percent: f64,
    /// Correlation of estimate and sensor.
    pub correlation: f64,
    /// Delay of the estimate: the lag at which the error is least, s.
    pub delay_s: f64,
    /// Samples counted.
    pub samples: u64,
}

impl Score {
    /// No samples yet.
    #[must_use]
    pub fn new(sample_period: f64) -> Self {
        Self {
            sample_period,
            count: 0.0,
            max: 0.0,
            square: 0.0,
            sums: [0.0; 5],
            sensor: VecDeque::with_capacity(LAGS),
            lagged: [0.0; LAGS],
            lagged_count: 0.0,
        }
    }

    /// Takes one estimate and the sensor's torque of the same instant.
    pub fn add(&mut self, estimate: f64, sensor: f64) {
        let error = estimate - sensor;
        self.count += 1.0;
        self.max = self.max.max(error.abs());
        self.square += error * error;
        let products = [
            estimate,
            sensor,
            estimate * estimate,
            sensor * sensor,
            estimate * sensor,
        ];
        self.sums
            .iter_mut()
            .zip(products)
            .for_each(|(sum, x)| *sum += x);
        if self.sensor.len() == LAGS {
            self.sensor.pop_back();
        }
        self.sensor.push_front(sensor);
        if self.sensor.len() == LAGS {
            self.lagged_count += 1.0;
            for (sum, sensor) in self.lagged.iter_mut().zip(&self.sensor) {
                *sum += (estimate - sensor).powi(2);
            }
        }
    }

    /// The figures so far; none before any sample.
    #[must_use]
    pub fn figures(&self) -> Option<Figures> {
        if self.count == 0.0 {
            return None;
        }
        let [x, y, xx, yy, xy] = self.sums.map(|s| s / self.count);
        let spread = ((xx - x * x) * (yy - y * y)).max(0.0).sqrt();
        let rms = (self.square / self.count).sqrt();
        Some(Figures {
            max: self.max,
            rms,
            rms_percent: if yy > 0.0 {
                100.0 * rms / yy.sqrt()
            } else {
                f64::INFINITY
            },
            correlation: if spread > 0.0 {
                (xy - x * y) / spread
            } else {
                0.0
            },
            delay_s: self.delay() * self.sample_period,
            samples: self.count as u64,
        })
    }

    /// The lag of the least error, samples, between samples by a parabola.
    fn delay(&self) -> f64 {
        let by_error = |a: &usize, b: &usize| self.lagged[*a].total_cmp(&self.lagged[*b]);
        let best = (0..LAGS).min_by(by_error).unwrap_or(0);
        if self.lagged_count == 0.0 || best == 0 || best + 1 == LAGS {
            return best as f64;
        }
        let [left, middle, right] = [best - 1, best, best + 1].map(|i| self.lagged[i]);
        let curvature = left - 2.0 * middle + right;
        let offset = if curvature > 0.0 {
            0.5 * (left - right) / curvature
        } else {
            0.0
        };
        best as f64 + offset
    }
}

#[cfg(test)]
mod tests {
    use super::Score;

    #[test]
    fn a_late_copy_is_recognised() {
        let mut score = Score::new(1e-3);
        let torque = |t: f64| 5.0 * (0.03 * t).sin() + 2.0 * (0.011 * t).cos();
        for i in 0..5000 {
            let t = f64::from(i);
            score.add(torque(t - 7.3), torque(t));
        }
        let figures = score.figures().unwrap();
        assert!(
            (figures.delay_s - 7.3e-3).abs() < 2e-4,
            "{}",
            figures.delay_s
        );
        assert!(figures.correlation > 0.95 && figures.max > figures.rms);
    }

    #[test]
    fn figures_are_those_of_the_errors() {
        let mut score = Score::new(1e-3);
        assert!(score.figures().is_none());
        for i in 0..1000 {
            let error = if i % 2 == 0 { 0.3 } else { -0.1 };
            score.add(2.0 + error, 2.0);
        }
        let figures = score.figures().unwrap();
        assert!((figures.max - 0.3).abs() < 1e-12);
        assert!((figures.rms - 0.05f64.sqrt()).abs() < 1e-12);
        assert!((figures.rms_percent - 50.0 * 0.05f64.sqrt()).abs() < 1e-9);
    }
}
