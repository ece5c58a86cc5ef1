//! From an F/T sensor's raw sample to a wrench, with offsets that change without a step.

use robot_config::FtParameters;
use robot_state::Wrench;
use whole_body::FtConditioning;

/// Duration of the ramp from one offset to the next, s.
///
/// Filters of higher order, or read beside their middle, overshoot after a step of the offset. This ramp is slow for
/// all of them: three lengths of the default ones, of 80 samples at 1 kHz.
const RAMP_S: f64 = 0.25;

/// One sensor's conditioning.
#[derive(Debug)]
pub(crate) struct FtInput {
    /// The configuration's offset.
    configured: [f64; 6],
    /// Conditioning with the offset of this cycle.
    conditioning: FtConditioning,
    has_temperature: bool,
    /// Greatest |tare| of each axis: what the sensor can show, N and N·m.
    most: [f64; 6],
    /// Tare at the start and at the end of the ramp, and the ramp's progress, 0 to 1.
    from: [f64; 6],
    to: [f64; 6],
    share: f64,
    /// A sample has arrived, and filters remember it.
    seen: bool,
}

impl FtInput {
    pub(crate) fn new(parameters: &FtParameters) -> Self {
        Self {
            configured: parameters.conditioning.offset,
            conditioning: parameters.conditioning.clone(),
            has_temperature: parameters.has_temperature,
            most: parameters.reach(),
            from: [0.0; 6],
            to: [0.0; 6],
            share: 1.0,
            seen: false,
        }
    }

    /// Moves the offset towards a tare by one period; at once before the first sample.
    pub(crate) fn follow(&mut self, tare: &Wrench, period_s: f64) {
        let tare = tare.to_array();
        // A tare that the sensor cannot show is none: against it every sample would look the same.
        let shown = |(x, most): (&f64, &f64)| x.is_finite() && x.abs() <= *most;
        if tare != self.to && tare.iter().zip(&self.most).all(shown) {
            (self.from, self.to, self.share) = (self.tare(), tare, 0.0);
        }
        self.share = if self.seen {
            (self.share + period_s / RAMP_S).min(1.0)
        } else {
            1.0
        };
        let tare = self.tare();
        let offset = self.configured.iter().zip(tare);
        for (sum, (configured, tare)) in self.conditioning.offset.iter_mut().zip(offset) {
            *sum = configured + tare;
        }
    }

    /// The tare that the offset moves towards.
    pub(crate) fn target(&self) -> Wrench {
        Wrench::from_array(self.to)
    }

    /// The wrench of a raw sample; temperature in °C.
    pub(crate) fn wrench(&mut self, raw: &[f64; 6], temperature: f64) -> Wrench {
        self.seen = true;
        let temperature = self.has_temperature.then_some(temperature);
        self.conditioning.apply(raw, temperature)
    }

    /// The offset that is subtracted in this cycle.
    pub(crate) fn offset(&self) -> Wrench {
        Wrench::from_array(self.conditioning.offset)
    }

    fn tare(&self) -> [f64; 6] {
        if self.share >= 1.0 {
            return self.to;
        }
        std::array::from_fn(|k| self.from[k] + self.share * (self.to[k] - self.from[k]))
    }
}
