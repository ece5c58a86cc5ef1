//! Random numbers of the family: SplitMix64, seeded per specimen and stream.

/// A generator.
#[derive(Debug, Clone)]
pub struct Draw(u64);

impl Draw {
    /// The generator of one specimen and one of its streams.
    #[must_use]
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut draw = Self(seed.wrapping_mul(0x9E37_79B9).wrapping_add(stream << 40));
        for _ in 0..4 {
            draw.bits();
        }
        draw
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform between two bounds.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Log-uniform between two positive bounds.
    pub fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.within(low.ln(), high.ln()).exp()
    }

    /// Normal, of standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.within(1e-300, 1.0).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.within(0.0, 1.0)).cos()
    }

    /// One of several.
    pub fn choice<T: Copy>(&mut self, of: &[T]) -> T {
        of[(self.bits() % of.len() as u64) as usize]
    }
}
