//! From an F/T sensor's raw reading to a wrench: calibration, tare, temperature.

use robot_state::Wrench;

/// `w = C raw - offset + k_T (T - T0)`.
#[derive(Debug, Clone, PartialEq)]
pub struct FtConditioning {
    /// C: calibration matrix, by rows, force first (6×6).
    pub calibration: [[f64; 6]; 6],
    /// Reading without load at T0, N and N·m, after calibration (6); a tare determines it.
    pub offset: [f64; 6],
    /// k_T: correction for each degree above T0, N/K and N·m/K (6).
    pub temperature_gain: [f64; 6],
    /// T0: temperature at which `offset` holds, °C.
    pub reference_temperature: f64,
}

impl Default for FtConditioning {
    /// For a sensor whose readings are wrenches.
    fn default() -> Self {
        Self {
            calibration: std::array::from_fn(|i| {
                std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })
            }),
            offset: [0.0; 6],
            temperature_gain: [0.0; 6],
            reference_temperature: 0.0,
        }
    }
}

impl FtConditioning {
    /// The wrench of a raw sample. `temperature`, °C; none leaves its term out.
    #[must_use]
    pub fn apply(&self, raw: &[f64; 6], temperature: Option<f64>) -> Wrench {
        let warmer = temperature.map_or(0.0, |t| t - self.reference_temperature);
        let w: [f64; 6] = std::array::from_fn(|i| {
            let calibrated: f64 = self.calibration[i]
                .iter()
                .zip(raw)
                .map(|(c, x)| c * x)
                .sum();
            calibrated - self.offset[i] + self.temperature_gain[i] * warmer
        });
        Wrench::from_array(w)
    }

    /// Takes a tare's correction into the offset.
    pub fn correct(&mut self, correction: &[f64; 6]) {
        for (offset, x) in self.offset.iter_mut().zip(correction) {
            *offset += x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_term_counts() {
        let mut c = FtConditioning {
            offset: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            temperature_gain: [0.1, 0.0, 0.0, 0.0, 0.0, -0.5],
            reference_temperature: 25.0,
            ..FtConditioning::default()
        };
        c.calibration[0][5] = 2.0;
        let w = c.apply(&[10.0, 20.0, 30.0, 40.0, 50.0, 60.0], Some(35.0));
        assert_eq!(w.force, [10.0 + 120.0 - 1.0 + 1.0, 18.0, 27.0]);
        assert_eq!(w.torque, [36.0, 45.0, 60.0 - 6.0 - 5.0]);
        let cold = c.apply(&[0.0; 6], None);
        assert_eq!(cold.force, [-1.0, -2.0, -3.0]);
        c.correct(&[-1.0, -2.0, -3.0, -4.0, -5.0, -6.0]);
        assert_eq!(c.apply(&[0.0; 6], None), Wrench::default());
    }
}
