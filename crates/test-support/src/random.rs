//! Random numbers that a seed repeats.

use std::f64::consts::TAU;

/// Steele, Lea and Flood's SplitMix64 (2014): 64 bits of state, passes the usual batteries.
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
}

impl Random {
    /// A generator: the same seed gives the same numbers.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// A seed that goes on with the numbers that this generator would draw next.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.state
    }

    /// 64 bits, each 0 or 1 with equal probability.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// An integer from 0 to `n - 1`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// Uniform in (0, 1).
    pub fn unit(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// Uniform in (-1, 1).
    pub fn symmetric(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Numbers uniform in (-1, 1).
    pub fn array<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.symmetric())
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.unit().ln()).sqrt() * (TAU * self.unit()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    const COUNT: usize = 40_000;

    /// First, second and fourth moment, which have standard errors of at most 0.05 here.
    fn moments(mut draw: impl FnMut() -> f64) -> [f64; 3] {
        let draws: Vec<f64> = (0..COUNT).map(|_| draw()).collect();
        [1, 2, 4].map(|power| draws.iter().map(|x| x.powi(power)).sum::<f64>() / COUNT as f64)
    }

    fn assert_near(moments: [f64; 3], expected: [f64; 3], tolerance: f64) {
        for (moment, expected) in moments.into_iter().zip(expected) {
            assert!((moment - expected).abs() < tolerance, "{moment} {expected}");
        }
    }

    #[test]
    fn distributions_have_their_moments() {
        let mut random = Random::new(7);
        let unit = [1.0 / 2.0, 1.0 / 3.0, 1.0 / 5.0];
        assert_near(moments(|| random.unit()), unit, 0.01);
        let symmetric = [0.0, 1.0 / 3.0, 1.0 / 5.0];
        assert_near(moments(|| random.symmetric()), symmetric, 0.01);
        assert_near(moments(|| random.normal()), [0.0, 1.0, 3.0], 0.15);
    }

    #[test]
    fn integers_are_equally_frequent() {
        let mut random = Random::new(1);
        let mut counts = [0_usize; 7];
        for _ in 0..COUNT {
            counts[random.below(7)] += 1;
        }
        for count in counts {
            assert!(count.abs_diff(COUNT / 7) < 300, "{counts:?}");
        }
    }

    #[test]
    fn a_seed_repeats_and_another_differs() {
        assert_eq!(Random::new(3).array::<9>(), Random::new(3).array::<9>());
        assert_ne!(Random::new(3).bits(), Random::new(4).bits());
        // The reference implementation's first number for seed 0.
        assert_eq!(Random::new(0).bits(), 0xE220_A839_7B1D_CDAF);
    }
}
