//! Configurations: neutral, random, and moved along a velocity.

use crate::kinematics::{at, base_placement, six};
use crate::model::{Base, Model};
use crate::spatial::Se3;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The configuration of all zeros, a floating base at the world's origin.
pub fn neutral(model: &Model) -> Vec<f64> {
    let mut q = vec![0.0; model.nq()];
    if model.base == Base::Floating {
        q[6] = 1.0;
    }
    q
}

/// Moves `q` along `v` for `dt` seconds, in place; the base along the screw of its twist.
pub fn integrate(model: &Model, q: &mut [f64], v: &[f64], dt: f64) {
    let (bv, bq) = model.base_size();
    if model.base == Base::Floating && q.len() >= 7 {
        let step = exponential(six(v).linear * dt, six(v).angular * dt);
        let moved = base_placement(model, q).compose(&step);
        let r = Rotation3::from_matrix_unchecked(moved.rotation);
        let quaternion = UnitQuaternion::from_rotation_matrix(&r);
        q[..3].copy_from_slice(moved.translation.as_slice());
        q[3..7].copy_from_slice(quaternion.coords.as_slice());
    }
    for (i, x) in q.iter_mut().skip(bq).enumerate() {
        *x += dt * at(v, bv + i);
    }
}

/// Placement reached after unit time with the twist `(linear, angular)`.
fn exponential(linear: Vector3<f64>, angular: Vector3<f64>) -> Se3 {
    let angle = angular.norm();
    let w = angular.cross_matrix();
    // (1 - cos x)/x² and (x - sin x)/x³, by series where they cancel
    let (b, c) = if angle < 1e-3 {
        let x2 = angle * angle;
        (0.5 - x2 / 24.0, 1.0 / 6.0 - x2 / 120.0)
    } else {
        let (s, co) = angle.sin_cos();
        (
            (1.0 - co) / (angle * angle),
            (angle - s) / (angle * angle * angle),
        )
    };
    let left: Matrix3<f64> = Matrix3::identity() + w * b + w * w * c;
    let rotation = UnitQuaternion::from_scaled_axis(angular).to_rotation_matrix();
    Se3::new(rotation.into_inner(), left * linear)
}

/// A small generator of repeatable pseudo-random numbers (xorshift64*), for tests and benchmarks.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Seeded; the same seed gives the same numbers.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }
    /// Uniform in `[lower, upper)`.
    pub fn uniform(&mut self, lower: f64, upper: f64) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        lower + (upper - lower) * (bits as f64 / (1u64 << 53) as f64)
    }
    /// A vector uniform in `[-size, size)`.
    pub fn vector(&mut self, length: usize, size: f64) -> Vec<f64> {
        (0..length).map(|_| self.uniform(-size, size)).collect()
    }
    /// A configuration: joints within ±pi rad, base within 1 m and of any orientation.
    pub fn configuration(&mut self, model: &Model) -> Vec<f64> {
        let mut q = self.vector(model.nq(), std::f64::consts::PI);
        if model.base == Base::Floating {
            for x in &mut q[..3] {
                *x /= std::f64::consts::PI;
            }
            let norm = q[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
            for x in &mut q[3..7] {
                *x /= norm;
            }
        }
        q
    }
}
