//! Four numbers side by side: one code for AVX2 and for any processor.
//!
//! The algorithms are written once over [`Lanes`], as a [`Kernel`]. [`run`] executes it with the
//! instructions that [`Instructions::detect`] found; all implementations compute the same
//! expressions and differ only in rounding (a fused multiply-add rounds once).
#![deny(unsafe_code)]

#[cfg(target_arch = "x86_64")]
mod avx2;
mod matrix;
mod portable;
mod sin_cos;
mod vector;

pub use matrix::M3;
pub use sin_cos::sin_cos;
pub use vector::{Places, V3, load_all, scatter_add, store_all};

use std::ops::{Add, Mul, Neg, Sub};

/// Lanes side by side.
pub const WIDTH: usize = 4;

/// Four numbers in memory, aligned for a vector load.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[repr(C, align(32))]
pub struct Pack(pub [f64; WIDTH]);

impl Pack {
    /// Four zeros.
    pub const ZERO: Pack = Pack([0.0; WIDTH]);
}

/// 1.5 * 2^52: added to a number and taken away again, it rounds the number to an integer; added
/// to an integer, it leaves that one in the low bits.
const ROUNDS: f64 = 6_755_399_441_055_744.0;

/// Four numbers in registers.
pub trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// Twice as many numbers in single precision.
    type Single: SingleLanes;
    /// True if a multiply-add rounds once.
    const FUSED: bool;
    /// From memory.
    fn load(p: &Pack) -> Self;
    /// To memory.
    fn store(self, p: &mut Pack);
    /// The first four numbers of `x`; zero beyond its end.
    fn load_part(x: &[f64]) -> Self;
    /// To the first four numbers of `x`; what is beyond its end is dropped.
    fn store_part(self, x: &mut [f64]);
    /// From four numbers.
    fn set(x: [f64; WIDTH]) -> Self;
    /// The same number four times.
    fn splat(x: f64) -> Self;
    /// `self * a + b`.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// `b - self * a`.
    fn neg_mul_add(self, a: Self, b: Self) -> Self;
    /// Nearest integer, for magnitudes below 2^51.
    #[inline(always)]
    fn round(self) -> Self {
        let magic = Self::splat(ROUNDS);
        (self + magic) - magic
    }
    /// `1 / self`.
    fn recip(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// The larger of both; either of them if one is not a number.
    fn max(self, o: Self) -> Self;
    /// 2 to the power of whole numbers within ±1022.
    fn exp2_of_integer(self) -> Self;
    /// The second to fourth number, then zero.
    fn down_one(self) -> Self;
    /// The third and fourth number, then zeros.
    fn down_two(self) -> Self;
    /// The second, third, first and fourth number.
    fn turn_three(self) -> Self;
    /// The transpose of four rows.
    fn transpose(rows: [Self; WIDTH]) -> [Self; WIDTH];
    /// The transpose of four rows in memory.
    fn load_transposed(rows: [&Pack; WIDTH]) -> [Self; WIDTH];
    /// Cross product of two vectors in the first three lanes; the fourth becomes zero where it was
    /// finite.
    #[inline(always)]
    fn cross_in_lanes(self, o: Self) -> Self {
        (self.turn_three().neg_mul_add(o, self * o.turn_three())).turn_three()
    }
    /// True if every magnitude is below `bound`; false for not-a-number.
    fn all_within(self, bound: f64) -> bool;
    /// Four numbers.
    #[inline(always)]
    fn to_array(self) -> [f64; WIDTH] {
        let mut p = Pack::ZERO;
        self.store(&mut p);
        p.0
    }
}

/// Lanes of single precision side by side.
pub const SINGLE_WIDTH: usize = 8;

/// Eight numbers of single precision in memory, aligned for a vector load.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[repr(C, align(32))]
pub struct SinglePack(pub [f32; SINGLE_WIDTH]);

impl SinglePack {
    /// Eight zeros.
    pub const ZERO: SinglePack = SinglePack([0.0; SINGLE_WIDTH]);
}

/// 1.5 * 2^23: the counterpart of [`ROUNDS`] in single precision.
const SINGLE_ROUNDS: f32 = 12_582_912.0;

/// Eight numbers of single precision in registers.
pub trait SingleLanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// From memory.
    fn load(p: &SinglePack) -> Self;
    /// To memory.
    fn store(self, p: &mut SinglePack);
    /// The same number eight times.
    fn splat(x: f32) -> Self;
    /// `self * a + b`.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// The larger of both; either of them if one is not a number.
    fn max(self, o: Self) -> Self;
    /// Nearest integer, for magnitudes below 2^22.
    #[inline(always)]
    fn round(self) -> Self {
        let magic = Self::splat(SINGLE_ROUNDS);
        (self + magic) - magic
    }
    /// 2 to the power of whole numbers within ±126.
    fn exp2_of_integer(self) -> Self;
    /// Eight numbers.
    #[inline(always)]
    fn to_array(self) -> [f32; SINGLE_WIDTH] {
        let mut p = SinglePack::ZERO;
        self.store(&mut p);
        p.0
    }
}

/// Four components of `x`; zero where an index is beyond its end (an idle lane).
#[inline(always)]
pub fn gather<L: Lanes>(x: &[f64], indices: &[usize; WIDTH]) -> L {
    let [a, b, c, d] = *indices;
    L::set([or_zero(x, a), or_zero(x, b), or_zero(x, c), or_zero(x, d)])
}

#[inline(always)]
fn or_zero(x: &[f64], i: usize) -> f64 {
    match x.get(i) {
        Some(x) => *x,
        None => 0.0,
    }
}

/// Code over any implementation of [`Lanes`].
pub trait Kernel {
    /// Its result.
    type Output;
    /// Computes it.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Implementation that runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instructions {
    /// Any processor.
    Portable,
    /// x86-64 with AVX2 and FMA.
    Avx2,
}

impl Instructions {
    /// The best that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            return Instructions::Avx2;
        }
        Instructions::Portable
    }
}

/// Runs a kernel with the given instructions.
#[inline]
pub fn run<K: Kernel>(instructions: Instructions, kernel: K) -> K::Output {
    match instructions {
        Instructions::Portable => portable::run(kernel),
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2 => avx2::run(kernel),
        #[cfg(not(target_arch = "x86_64"))]
        Instructions::Avx2 => portable::run(kernel),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts of a slice, to its end and beyond.
    struct Parts<'a>(&'a mut [f64]);
    impl Kernel for Parts<'_> {
        type Output = ();
        fn run<L: Lanes>(self) {
            let doubled = L::load_part(self.0) + L::load_part(self.0);
            doubled.store_part(self.0);
        }
    }

    #[test]
    fn parts_of_slices() {
        for instructions in [Instructions::Portable, Instructions::detect()] {
            for count in 0..=6 {
                let mut x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
                run(instructions, Parts(&mut x[1..1 + count]));
                for (k, x) in x.iter().enumerate() {
                    let doubled = (1..1 + count.min(WIDTH)).contains(&k);
                    assert_eq!(*x, (k + 1) as f64 * if doubled { 2.0 } else { 1.0 });
                }
            }
        }
    }

    struct SinCos(Pack);
    impl Kernel for SinCos {
        type Output = [[f64; WIDTH]; 2];
        fn run<L: Lanes>(self) -> Self::Output {
            let (s, c) = sin_cos(L::load(&self.0));
            [s.to_array(), c.to_array()]
        }
    }

    /// Against the standard library, over many turns, near the quadrants' edges and out of range.
    #[test]
    fn sine_and_cosine() {
        let mut angles: Vec<f64> = (-40_000..40_000).map(|i| i as f64 * 1.234_567e-3).collect();
        angles.extend((-2000..2000).map(|i| i as f64 * std::f64::consts::FRAC_PI_4));
        angles.extend([0.0, -0.0, 1e-300, 9.9e4, -9.9e4, 1.1e5, 1e17]);
        for instructions in [Instructions::Portable, Instructions::detect()] {
            for a in &angles {
                let [s, c] = run(instructions, SinCos(Pack([*a, -*a, 0.5, *a])));
                assert!((s[0] - a.sin()).abs() <= 2.3e-16, "sin {a}");
                assert!((c[3] - a.cos()).abs() <= 2.3e-16, "cos {a}");
                assert_eq!(s[1], -s[0]);
                assert!((s[2] - 0.5f64.sin()).abs() <= 2.3e-16);
            }
            let [s, c] = run(
                instructions,
                SinCos(Pack([f64::NAN, f64::INFINITY, 0.0, 1.0])),
            );
            assert!(s[0].is_nan() && c[1].is_nan() && c[2] == 1.0);
        }
    }
}
