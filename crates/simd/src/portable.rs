//! Any processor: four numbers in an array, which the compiler vectorises where it can.

use crate::{
    Kernel, Lanes, Pack, ROUNDS, SINGLE_ROUNDS, SINGLE_WIDTH, SingleLanes, SinglePack, WIDTH,
};
use std::ops::{Add, Mul, Neg, Sub};

/// Runs a kernel. (Apart, so that callers stay small where another implementation runs.)
#[inline(never)]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Portable>()
}

#[derive(Clone, Copy)]
pub(super) struct Portable([f64; WIDTH]);

impl Portable {
    #[inline(always)]
    fn zip(self, o: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Portable(std::array::from_fn(|i| f(self.0[i], o.0[i])))
    }
}

impl Lanes for Portable {
    type Single = PortableSingle;
    const FUSED: bool = false;
    #[inline(always)]
    fn load(p: &Pack) -> Self {
        Portable(p.0)
    }
    #[inline(always)]
    fn store(self, p: &mut Pack) {
        p.0 = self.0;
    }
    #[inline(always)]
    fn load_part(x: &[f64]) -> Self {
        Portable(std::array::from_fn(|k| x.get(k).copied().unwrap_or(0.0)))
    }
    #[inline(always)]
    fn store_part(self, x: &mut [f64]) {
        for (to, from) in x.iter_mut().zip(self.0) {
            *to = from;
        }
    }
    #[inline(always)]
    fn set(x: [f64; WIDTH]) -> Self {
        Portable(x)
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Portable([x; WIDTH])
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        b - self * a
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Portable(self.0.map(|x| 1.0 / x))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Portable(self.0.map(f64::abs))
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        self.zip(o, f64::max)
    }
    #[inline(always)]
    fn exp2_of_integer(self) -> Self {
        let one = 1.0f64.to_bits();
        Portable(
            self.0
                .map(|k| f64::from_bits(((k + ROUNDS).to_bits() << 52).wrapping_add(one))),
        )
    }
    #[inline(always)]
    fn down_one(self) -> Self {
        let [_, y, z, w] = self.0;
        Portable([y, z, w, 0.0])
    }
    #[inline(always)]
    fn down_two(self) -> Self {
        let [_, _, z, w] = self.0;
        Portable([z, w, 0.0, 0.0])
    }
    #[inline(always)]
    fn turn_three(self) -> Self {
        let [x, y, z, w] = self.0;
        Portable([y, z, x, w])
    }
    #[inline(always)]
    fn transpose(rows: [Self; WIDTH]) -> [Self; WIDTH] {
        std::array::from_fn(|k| Portable(rows.map(|row| row.0[k])))
    }
    #[inline(always)]
    fn load_transposed(rows: [&Pack; WIDTH]) -> [Self; WIDTH] {
        std::array::from_fn(|k| Portable(rows.map(|row| row.0[k])))
    }
    #[inline(always)]
    fn all_within(self, bound: f64) -> bool {
        self.0.iter().all(|x| x.abs() < bound)
    }
}

impl Add for Portable {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(o, |x, y| x + y)
    }
}

impl Sub for Portable {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(o, |x, y| x - y)
    }
}

impl Mul for Portable {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(o, |x, y| x * y)
    }
}

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Portable(self.0.map(|x| -x))
    }
}

#[derive(Clone, Copy)]
pub(super) struct PortableSingle([f32; SINGLE_WIDTH]);

impl PortableSingle {
    #[inline(always)]
    fn zip(self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        PortableSingle(std::array::from_fn(|i| f(self.0[i], o.0[i])))
    }
}

impl SingleLanes for PortableSingle {
    #[inline(always)]
    fn load(p: &SinglePack) -> Self {
        PortableSingle(p.0)
    }
    #[inline(always)]
    fn store(self, p: &mut SinglePack) {
        p.0 = self.0;
    }
    #[inline(always)]
    fn splat(x: f32) -> Self {
        PortableSingle([x; SINGLE_WIDTH])
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        self.zip(o, f32::max)
    }
    #[inline(always)]
    fn exp2_of_integer(self) -> Self {
        let one = 1f32.to_bits();
        let power = |k: f32| ((k + SINGLE_ROUNDS).to_bits() << 23).wrapping_add(one);
        PortableSingle(self.0.map(|k| f32::from_bits(power(k))))
    }
}

impl Add for PortableSingle {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(o, |x, y| x + y)
    }
}

impl Sub for PortableSingle {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(o, |x, y| x - y)
    }
}

impl Mul for PortableSingle {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(o, |x, y| x * y)
    }
}
