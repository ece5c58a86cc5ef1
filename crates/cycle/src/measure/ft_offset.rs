//! From an F/T sensor's raw sample to a wrench, with offsets that change without a step.

use robot_config::FtParameters;
use robot_state::Wrench;
use whole_body::FtConditioning;

/// Time over which an offset gives way to another, s.
///
/// A moving average would turn a step of the offset into a ramp by itself; filters of higher order,
/// or read beside their middle, would overshoot. This ramp is slow for all of them.
const BLEND_S: f64 = 0.25;

/// One sensor's conditioning.
#[derive(Debug)]
pub(crate) struct FtInput {
    /// As configured, and with the offset of this cycle.
    configured: [f64; 6],
    conditioning: FtConditioning,
    has_temperature: bool,
    /// What a tare found: where the offset comes from, goes to, and how far it is on its way, 0
    /// to 1.
    from: [f64; 6],
    to: [f64; 6],
    share: f64,
    /// A sample has come: filters remember it.
    seen: bool,
}

impl FtInput {
    pub(crate) fn new(parameters: &FtParameters) -> Self {
        Self {
            configured: parameters.conditioning.offset,
            conditioning: parameters.conditioning.clone(),
            has_temperature: parameters.has_temperature,
            from: [0.0; 6],
            to: [0.0; 6],
            share: 1.0,
            seen: false,
        }
    }

    /// One period later: moves towards what a tare found; at once where nothing was measured yet.
    pub(crate) fn follow(&mut self, tare: &Wrench, period_s: f64) {
        let wanted = tare.to_array();
        if wanted != self.to && wanted.iter().all(|x| x.is_finite()) {
            (self.from, self.to, self.share) = (self.tare(), wanted, 0.0);
        }
        self.share = match self.seen {
            true => (self.share + period_s / BLEND_S).min(1.0),
            false => 1.0,
        };
        let tare = self.tare();
        let offset = self.configured.iter().zip(tare);
        for (sum, (configured, tare)) in self.conditioning.offset.iter_mut().zip(offset) {
            *sum = configured + tare;
        }
    }

    /// The wrench of a raw sample, °C.
    pub(crate) fn wrench(&mut self, raw: &[f64; 6], temperature: f64) -> Wrench {
        self.seen = true;
        let temperature = self.has_temperature.then_some(temperature);
        self.conditioning.apply(raw, temperature)
    }

    /// What is taken off in this cycle.
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
