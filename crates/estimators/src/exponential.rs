//! The exponential of four numbers at a time.

use simd::{Lanes, SingleLanes};

/// Largest |x|; the exponential is held beyond, at 1e-304 and 1e304.
const MAX_EXPONENT: f64 = 700.0;
/// 1/n! for n from 0 to 11.
const SERIES: [f64; 12] = [
    1.0,
    1.0,
    0.5,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
];

/// `exp(x)` to 1e-14 relative, for |x| up to [`MAX_EXPONENT`] and held beyond.
///
/// `exp(x) = 2^k exp(r)`, k the nearest integer to x/ln 2, r by its Taylor series: |r| < 0.347, so
/// the truncation error of the series is below 7e-15.
#[inline(always)]
pub(crate) fn exp<L: Lanes>(x: L) -> L {
    const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let x = -(-x.max(L::splat(-MAX_EXPONENT))).max(L::splat(-MAX_EXPONENT));
    let k = (x * L::splat(std::f64::consts::LOG2_E)).round();
    let r = k.neg_mul_add(L::splat(LN2_LOW), k.neg_mul_add(L::splat(LN2_HIGH), x));
    // Estrin's order: terms in pairs, to hide the latency of each sum.
    let (r2, c) = (r * r, |i: usize| L::splat(SERIES[i]));
    let r4 = r2 * r2;
    let four = |i: usize| {
        let (low, high) = (r.mul_add(c(i + 1), c(i)), r.mul_add(c(i + 3), c(i + 2)));
        high.mul_add(r2, low)
    };
    let series = four(8).mul_add(r4, four(4)).mul_add(r4, four(0));
    series * k.exp2_of_integer()
}

/// 2^r by its Taylor series: (ln 2)^n/n! for n from 7 down to 0.
const SINGLE_SERIES: [f32; 8] = [
    1.525_273_4e-5,
    1.540_353e-4,
    1.333_355_8e-3,
    9.618_129e-3,
    5.550_411e-2,
    0.240_226_5,
    std::f32::consts::LN_2,
    1.0,
];

/// `exp(-x/2)` for x >= 0 in single precision, to within 3e-7; 1e-38 for x beyond 175.
///
/// `2^t` with `t = k + r`, k the nearest integer, |r| at most a half.
#[inline(always)]
pub(crate) fn single_exp_of_minus_half<S: SingleLanes>(x: S) -> S {
    let t = (x * S::splat(-0.5 * std::f32::consts::LOG2_E)).max(S::splat(-126.0));
    let k = t.round();
    let r = t - k;
    let mut series = S::splat(SINGLE_SERIES[0]);
    for coefficient in &SINGLE_SERIES[1..] {
        series = series.mul_add(r, S::splat(*coefficient));
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
    use super::{exp, sigmoid, single_exp_of_minus_half};
    use simd::{Instructions, Kernel, Lanes, SingleLanes, run};

    struct Both([f64; 4]);
    impl Kernel for Both {
        type Output = [[f64; 4]; 2];
        fn run<L: Lanes>(self) -> Self::Output {
            let x = L::set(self.0);
            [exp(x).to_array(), sigmoid(x).to_array()]
        }
    }

    struct Single(f32);
    impl Kernel for Single {
        type Output = f32;
        fn run<L: Lanes>(self) -> f32 {
            single_exp_of_minus_half(L::Single::splat(self.0)).to_array()[5]
        }
    }

    #[test]
    fn single_precision_against_the_standard_library() {
        for instructions in [Instructions::Portable, Instructions::detect()] {
            for i in 0..20_000 {
                let x = 0.01 * i as f32;
                let ours = f64::from(run(instructions, Single(x)));
                let error = ours - (-0.5 * f64::from(x)).exp();
                assert!(error.abs() < 3e-7, "{x}: {error}");
            }
            assert!(run(instructions, Single(f32::MAX)) < 2e-38);
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
