//! Reference model: how the torque is to follow what is desired.

/// Damping ratio of the model: its step goes beyond by exp(-0.8 pi / 0.6) = 1.5 %.
pub(super) const DAMPING: f64 = 0.8;

/// `w'' = w_r² (tau_d - w) - 2 zeta w_r w'`, solved exactly over a period in which `tau_d` is
/// constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ReferenceModel {
    frequency: f64,
    /// Step of a period: from distance to the desired torque and rate to both a period later.
    step: [[f64; 2]; 2],
}

/// w and w'.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct ReferenceState {
    /// w: N·m.
    pub(super) value: f64,
    /// w': N·m/s.
    pub(super) rate: f64,
}

impl ReferenceModel {
    pub(super) fn new(frequency: f64, dt: f64) -> Self {
        let decay = DAMPING * frequency;
        let ringing = frequency * (1.0 - DAMPING * DAMPING).sqrt();
        let (sin, cos) = (ringing * dt).sin_cos();
        let fade = (-decay * dt).exp();
        let s = sin / ringing;
        Self {
            frequency,
            step: [
                [fade * (cos + decay * s), fade * s],
                [-fade * frequency * frequency * s, fade * (cos - decay * s)],
            ],
        }
    }

    pub(super) fn advance(&self, state: &mut ReferenceState, desired: f64) {
        let [[a, b], [c, d]] = self.step;
        let (distance, rate) = (state.value - desired, state.rate);
        state.value = desired + a * distance + b * rate;
        state.rate = c * distance + d * rate;
    }

    /// w'': N·m/s².
    pub(super) fn curvature(&self, state: &ReferenceState, desired: f64) -> f64 {
        let w = self.frequency;
        w * w * (desired - state.value) - 2.0 * DAMPING * w * state.rate
    }
}

impl ReferenceState {
    pub(super) fn is_finite(&self) -> bool {
        self.value.is_finite() && self.rate.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exact_step_is_the_sum_of_small_ones() {
        let model = ReferenceModel::new(377.0, 1e-3);
        let mut state = ReferenceState {
            value: 3.0,
            rate: -40.0,
        };
        let mut small = state;
        model.advance(&mut state, 10.0);
        let h = 1e-7;
        for _ in 0..10_000 {
            let curvature = model.curvature(&small, 10.0);
            small.rate += h * curvature;
            small.value += h * small.rate;
        }
        assert!((state.value - small.value).abs() < 1e-4);
        assert!((state.rate - small.rate).abs() < 0.2, "{state:?} {small:?}");
    }
}
