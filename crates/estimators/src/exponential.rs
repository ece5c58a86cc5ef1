//! The exponential of four numbers at a time.

use dynamics::lanes::Lanes;

/// Beyond, the exponential is held: 1e-304 and 1e304.
const LARGEST: f64 = 700.0;
/// 1/n! for n from 11 down to 0.
const SERIES: [f64; 12] = [
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];

/// `exp(x)` to 1e-14 relative, for |x| up to [`LARGEST`] and held beyond.
///
/// `exp(x) = 2^k exp(r)`, k the nearest integer to x/ln 2, r by its Taylor series: |r| < 0.347, so
/// what the series leaves out is below 7e-15.
#[inline(always)]
pub(crate) fn exp<L: Lanes>(x: L) -> L {
    const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let x = -(-x.max(L::splat(-LARGEST))).max(L::splat(-LARGEST));
    let k = (x * L::splat(std::f64::consts::LOG2_E)).round();
    let r = k.neg_mul_add(L::splat(LN2_LOW), k.neg_mul_add(L::splat(LN2_HIGH), x));
    let mut series = L::splat(SERIES[0]);
    for coefficient in &SERIES[1..] {
        series = series.mul_add(r, L::splat(*coefficient));
    }
    series * k.exp2_of_integer()
}

/// The logistic function `1 / (1 + exp(-x))`.
#[inline(always)]
pub(crate) fn sigmoid<L: Lanes>(x: L) -> L {
    (L::splat(1.0) + exp(-x)).recip()
}

#[cfg(test)]
mod tests {
    use super::{exp, sigmoid};
    use dynamics::lanes::{Instructions, Kernel, Lanes, run};

    struct Both([f64; 4]);
    impl Kernel for Both {
        type Output = [[f64; 4]; 2];
        fn run<L: Lanes>(self) -> Self::Output {
            let x = L::set(self.0);
            [exp(x).to_array(), sigmoid(x).to_array()]
        }
    }

    #[test]
    fn against_the_standard_library() {
        for instructions in [Instructions::Portable, Instructions::detect()] {
            for i in 0..70_000 {
                let x = 0.01 * f64::from(i);
                let [e, s] = run(instructions, Both([x, -x, 0.5 * x, 0.0]));
                for (ours, x) in e.iter().zip([x, -x, 0.5 * x, 0.0]) {
                    assert!((ours / x.exp() - 1.0).abs() < 1e-14, "exp({x}): {ours}");
                }
                for (ours, x) in s.iter().zip([x, -x, 0.5 * x, 0.0]) {
                    assert!((ours * (1.0 + (-x).exp()) - 1.0).abs() < 2e-14, "{x}");
                }
            }
            let [e, s] = run(instructions, Both([1e300, -1e300, f64::INFINITY, -701.0]));
            assert!(e[0] > 1e303 && e[1] < 1e-303 && e[2] == e[0] && e[3] == e[1]);
            assert!(s[0] == 1.0 && s[1] < 1e-303 && s.iter().all(|s| s.is_finite()));
        }
    }
}
