//! Sine and cosine of four angles.

// The digits are fdlibm's.
#![allow(clippy::excessive_precision)]

use crate::Lanes;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// Largest angle for which the reduction below keeps full precision, rad.
const LARGEST: f64 = 1e5;
/// pi/2 less its double: with fused multiply-adds, which do not round products, two parts do.
const PIO2_REST: f64 = 6.123_233_995_736_766_035_87e-17;
// pi/2 in three parts; the first two have 33 bits, so that their products with small integers
// are exact without a fused multiply-add (fdlibm, e_rem_pio2.c).
const PIO2_1: f64 = 1.570_796_326_734_125_614_17;
const PIO2_2: f64 = 6.077_100_506_303_965_976_60e-11;
const PIO2_3: f64 = 2.022_266_248_795_950_631_54e-21;
// Minimax polynomials on [-pi/4, pi/4] (fdlibm, k_sin.c and k_cos.c).
const SIN: [f64; 6] = [
    1.589_690_995_211_550_102_21e-10,
    -2.505_076_025_340_686_341_95e-8,
    2.755_731_370_707_006_767_89e-6,
    -1.984_126_982_985_794_931_34e-4,
    8.333_333_333_322_489_461_24e-3,
    -1.666_666_666_666_663_243_48e-1,
];
const COS: [f64; 6] = [
    -1.135_964_755_778_819_482_65e-11,
    2.087_572_321_298_174_827_90e-9,
    -2.755_731_435_139_066_330_35e-7,
    2.480_158_728_947_672_941_78e-5,
    -1.388_888_888_887_410_957_49e-3,
    4.166_666_666_666_660_190_37e-2,
];

/// `(sin x, cos x)`, to about one unit in the last place.
#[inline(always)]
pub fn sin_cos<L: Lanes>(x: L) -> (L, L) {
    if !x.all_within(LARGEST) {
        // Rare, and not-a-number ends here too.
        let pairs = x.to_array().map(f64::sin_cos);
        return (L::set(pairs.map(|p| p.0)), L::set(pairs.map(|p| p.1)));
    }
    let turns = (x * L::splat(FRAC_2_PI)).round();
    let r = if L::FUSED {
        let r = turns.neg_mul_add(L::splat(FRAC_PI_2), x);
        turns.neg_mul_add(L::splat(PIO2_REST), r)
    } else {
        let r = turns.neg_mul_add(L::splat(PIO2_1), x);
        let r = turns.neg_mul_add(L::splat(PIO2_2), r);
        turns.neg_mul_add(L::splat(PIO2_3), r)
    };
    let z = r * r;
    let sin = (r * z).mul_add(polynomial(&SIN, z), r);
    let half = L::splat(0.5);
    let cos = (z * z).mul_add(polynomial(&COS, z), z.neg_mul_add(half, L::splat(1.0)));
    quadrant(turns, sin, cos)
}

/// Sine and cosine after `turns` quarter turns more, without a branch.
#[inline(always)]
fn quadrant<L: Lanes>(turns: L, sin: L, cos: L) -> (L, L) {
    // n = turns mod 4 in -2..=2. The cosine of n quarter turns is 1 - |n|, the sine n (2 - |n|).
    let quarters = (turns * L::splat(0.25)).round();
    let n = quarters.neg_mul_add(L::splat(4.0), turns);
    let even = L::splat(1.0) - n.abs();
    let odd = n * (L::splat(2.0) - n.abs());
    (
        even.mul_add(sin, odd * cos),
        odd.neg_mul_add(sin, even * cos),
    )
}

/// Polynomial of six coefficients, highest power first, in pairs: half as deep as Horner's form.
#[inline(always)]
fn polynomial<L: Lanes>(c: &[f64; 6], z: L) -> L {
    let z2 = z * z;
    let high = L::splat(c[0]).mul_add(z, L::splat(c[1]));
    let middle = L::splat(c[2]).mul_add(z, L::splat(c[3]));
    let low = L::splat(c[4]).mul_add(z, L::splat(c[5]));
    high.mul_add(z2, middle).mul_add(z2, low)
}
