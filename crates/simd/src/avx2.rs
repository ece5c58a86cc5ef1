//! AVX2 and FMA.
#![allow(unsafe_code)]

use crate::{Kernel, Lanes, Pack, ROUNDS, SINGLE_ROUNDS, SingleLanes, SinglePack, WIDTH};
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Neg, Sub};

/// A vector register. Only `run` generates code that uses it, and only where the processor has AVX2
/// and FMA: `Instructions::Avx2` comes from `detect`, or from `run`'s own check.
#[derive(Clone, Copy)]
pub(super) struct Avx2(__m256d);

/// Runs a kernel in AVX2, or portably where the processor lacks it.
#[inline]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
        // SAFETY: both features were just detected.
        unsafe { with_features(kernel) }
    } else {
        crate::portable::run(kernel)
    }
}

#[target_feature(enable = "avx2,fma")]
fn with_features<K: Kernel>(kernel: K) -> K::Output {
    // With something aligned on it, the stack is aligned, and registers that are spilled to it do not
    // straddle cache lines: a twentieth of a kernel's time.
    let aligned = Pack::ZERO;
    std::hint::black_box(&aligned);
    kernel.run::<Avx2>()
}

/// Mask of the first `count` lanes.
#[inline(always)]
unsafe fn first_lanes(count: usize) -> __m256i {
    // SAFETY: the caller has AVX2.
    unsafe {
        let count = _mm256_set1_epi64x(count.min(WIDTH) as i64);
        _mm256_cmpgt_epi64(count, _mm256_set_epi64x(3, 2, 1, 0))
    }
}

impl Lanes for Avx2 {
    type Single = Avx2Single;
    const FUSED: bool = true;
    #[inline(always)]
    fn load(p: &Pack) -> Self {
        // SAFETY: AVX is there (see `Avx2`); `Pack` is 32 readable bytes aligned to 32.
        Avx2(unsafe { _mm256_load_pd(p.0.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, p: &mut Pack) {
        // SAFETY: AVX is there; `Pack` is 32 writable bytes aligned to 32.
        unsafe { _mm256_store_pd(p.0.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn load_part(x: &[f64]) -> Self {
        if x.len() >= WIDTH {
            // SAFETY: AVX is there; `x` has at least 32 readable bytes.
            return Avx2(unsafe { _mm256_loadu_pd(x.as_ptr()) });
        }
        // SAFETY: AVX2 is there; lanes that the mask leaves out are not read.
        Avx2(unsafe { _mm256_maskload_pd(x.as_ptr(), first_lanes(x.len())) })
    }
    #[inline(always)]
    fn store_part(self, x: &mut [f64]) {
        // A masked store would not be forwarded to loads that follow it.
        let p = x.as_mut_ptr();
        // SAFETY: AVX is there; no more numbers are written than `x` has.
        unsafe {
            let (low, high) = (
                _mm256_castpd256_pd128(self.0),
                _mm256_extractf128_pd::<1>(self.0),
            );
            match x.len() {
                0 => {}
                1 => _mm_store_sd(p, low),
                2 => _mm_storeu_pd(p, low),
                3 => {
                    _mm_storeu_pd(p, low);
                    _mm_store_sd(p.add(2), high);
                }
                _ => _mm256_storeu_pd(p, self.0),
            }
        }
    }
    #[inline(always)]
    fn set(x: [f64; WIDTH]) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_set_pd(x[3], x[2], x[1], x[0]) })
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_set1_pd(x) })
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: FMA is there.
        Avx2(unsafe { _mm256_fmadd_pd(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: FMA is there.
        Avx2(unsafe { _mm256_fnmadd_pd(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn recip(self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_div_pd(_mm256_set1_pd(1.0), self.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_max_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn exp2_of_integer(self) -> Self {
        // SAFETY: AVX2 is there.
        unsafe {
            let low_bits = _mm256_castpd_si256(_mm256_add_pd(self.0, _mm256_set1_pd(ROUNDS)));
            let exponent = _mm256_slli_epi64::<52>(low_bits);
            let one = _mm256_castpd_si256(_mm256_set1_pd(1.0));
            Avx2(_mm256_castsi256_pd(_mm256_add_epi64(exponent, one)))
        }
    }
    #[inline(always)]
    fn down_one(self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_shuffle_pd::<0b0101>(self.0, self.down_two().0) })
    }
    #[inline(always)]
    fn down_two(self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_permute2f128_pd::<0x81>(self.0, self.0) })
    }
    #[inline(always)]
    fn turn_three(self) -> Self {
        // SAFETY: AVX2 is there.
        Avx2(unsafe { _mm256_permute4x64_pd::<0b11_00_10_01>(self.0) })
    }
    #[inline(always)]
    fn transpose([a, b, c, d]: [Self; WIDTH]) -> [Self; WIDTH] {
        // SAFETY: AVX is there.
        unsafe {
            let (even, odd) = (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpackhi_pd(a.0, b.0));
            let (even2, odd2) = (_mm256_unpacklo_pd(c.0, d.0), _mm256_unpackhi_pd(c.0, d.0));
            [
                Avx2(_mm256_permute2f128_pd::<0x20>(even, even2)),
                Avx2(_mm256_permute2f128_pd::<0x20>(odd, odd2)),
                Avx2(_mm256_permute2f128_pd::<0x31>(even, even2)),
                Avx2(_mm256_permute2f128_pd::<0x31>(odd, odd2)),
            ]
        }
    }
    #[inline(always)]
    fn load_transposed(rows: [&Pack; WIDTH]) -> [Self; WIDTH] {
        // Halves come from memory where they belong: half as many shuffles as `transpose`.
        // SAFETY: AVX is there; `Pack` is 32 readable bytes aligned to 32.
        unsafe {
            let [a, b, c, d] = rows;
            let (a, b, c, d) = (a.0.as_ptr(), b.0.as_ptr(), c.0.as_ptr(), d.0.as_ptr());
            let ac = _mm256_loadu2_m128d(c, a);
            let bd = _mm256_loadu2_m128d(d, b);
            let ac2 = _mm256_loadu2_m128d(c.add(2), a.add(2));
            let bd2 = _mm256_loadu2_m128d(d.add(2), b.add(2));
            [
                Avx2(_mm256_unpacklo_pd(ac, bd)),
                Avx2(_mm256_unpackhi_pd(ac, bd)),
                Avx2(_mm256_unpacklo_pd(ac2, bd2)),
                Avx2(_mm256_unpackhi_pd(ac2, bd2)),
            ]
        }
    }
    #[inline(always)]
    fn all_within(self, bound: f64) -> bool {
        // SAFETY: AVX is there.
        unsafe {
            let below = _mm256_cmp_pd::<_CMP_LT_OQ>(self.abs().0, _mm256_set1_pd(bound));
            _mm256_movemask_pd(below) == 0b1111
        }
    }
}

impl Add for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_add_pd(self.0, o.0) })
    }
}

impl Sub for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_sub_pd(self.0, o.0) })
    }
}

impl Mul for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_mul_pd(self.0, o.0) })
    }
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX is there.
        Avx2(unsafe { _mm256_xor_pd(self.0, _mm256_set1_pd(-0.0)) })
    }
}

/// A vector register of single precision; used as `Avx2` is.
#[derive(Clone, Copy)]
pub(super) struct Avx2Single(__m256);

impl SingleLanes for Avx2Single {
    #[inline(always)]
    fn load(p: &SinglePack) -> Self {
        // SAFETY: AVX is there (see `Avx2`); `SinglePack` is 32 readable bytes aligned to 32.
        Avx2Single(unsafe { _mm256_load_ps(p.0.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, p: &mut SinglePack) {
        // SAFETY: AVX is there; `SinglePack` is 32 writable bytes aligned to 32.
        unsafe { _mm256_store_ps(p.0.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: AVX is there.
        Avx2Single(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: FMA is there.
        Avx2Single(unsafe { _mm256_fmadd_ps(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2Single(unsafe { _mm256_max_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn exp2_of_integer(self) -> Self {
        // SAFETY: AVX2 is there.
        unsafe {
            let low_bits =
                _mm256_castps_si256(_mm256_add_ps(self.0, _mm256_set1_ps(SINGLE_ROUNDS)));
            let exponent = _mm256_slli_epi32::<23>(low_bits);
            let one = _mm256_castps_si256(_mm256_set1_ps(1.0));
            Avx2Single(_mm256_castsi256_ps(_mm256_add_epi32(exponent, one)))
        }
    }
}

impl Add for Avx2Single {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2Single(unsafe { _mm256_add_ps(self.0, o.0) })
    }
}

impl Sub for Avx2Single {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2Single(unsafe { _mm256_sub_ps(self.0, o.0) })
    }
}

impl Mul for Avx2Single {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        // SAFETY: AVX is there.
        Avx2Single(unsafe { _mm256_mul_ps(self.0, o.0) })
    }
}
