//! Spatial vectors, rigid placements and inertias.
//!
//! Six-vectors hold the linear part first, as Pinocchio does. A motion or force is expressed in
//! the axes of some frame, at that frame's origin; the user of each names it.

use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};

/// Twist or spatial acceleration: m/s and rad/s, or m/s² and rad/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// `v`, of the point of the body that is at the origin, m/s (3).
    pub linear: Vector3<f64>,
    /// `omega`, rad/s (3).
    pub angular: Vector3<f64>,
}

/// Wrench: N and N·m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// `f`, N (3).
    pub linear: Vector3<f64>,
    /// `n`, moment about the origin, N·m (3).
    pub angular: Vector3<f64>,
}

macro_rules! six_vector {
    ($name:ident) => {
        impl $name {
            /// From the linear and the angular part.
            #[inline]
            pub fn new(linear: Vector3<f64>, angular: Vector3<f64>) -> Self {
                Self { linear, angular }
            }
            /// All zeros.
            #[inline]
            pub fn zero() -> Self {
                Self::new(Vector3::zeros(), Vector3::zeros())
            }
            /// From six numbers, linear first.
            #[inline]
            pub fn from_array(x: [f64; 6]) -> Self {
                Self::new(
                    Vector3::new(x[0], x[1], x[2]),
                    Vector3::new(x[3], x[4], x[5]),
                )
            }
            /// As six numbers, linear first.
            #[inline]
            pub fn to_array(self) -> [f64; 6] {
                let (l, a) = (self.linear, self.angular);
                [l.x, l.y, l.z, a.x, a.y, a.z]
            }
            /// As a nalgebra vector, linear first.
            #[inline]
            pub fn to_vector(self) -> Vector6<f64> {
                Vector6::from_column_slice(&self.to_array())
            }
        }
        impl std::ops::Add for $name {
            type Output = Self;
            #[inline]
            fn add(self, o: Self) -> Self {
                Self::new(self.linear + o.linear, self.angular + o.angular)
            }
        }
        impl std::ops::Sub for $name {
            type Output = Self;
            #[inline]
            fn sub(self, o: Self) -> Self {
                Self::new(self.linear - o.linear, self.angular - o.angular)
            }
        }
        impl std::ops::AddAssign for $name {
            #[inline]
            fn add_assign(&mut self, o: Self) {
                *self = *self + o;
            }
        }
        impl std::ops::SubAssign for $name {
            #[inline]
            fn sub_assign(&mut self, o: Self) {
                *self = *self - o;
            }
        }
        impl std::ops::Mul<f64> for $name {
            type Output = Self;
            #[inline]
            fn mul(self, k: f64) -> Self {
                Self::new(self.linear * k, self.angular * k)
            }
        }
        impl std::ops::Neg for $name {
            type Output = Self;
            #[inline]
            fn neg(self) -> Self {
                Self::new(-self.linear, -self.angular)
            }
        }
    };
}
six_vector!(Motion);
six_vector!(Force);

impl Motion {
    /// `v × m`: the rate of `m`, fixed in a body that moves with `v`.
    #[inline]
    pub fn cross(self, m: Motion) -> Motion {
        Motion::new(
            self.angular.cross(&m.linear) + self.linear.cross(&m.angular),
            self.angular.cross(&m.angular),
        )
    }
    /// `v ×* f`: the rate of `f`, fixed in a body that moves with `v`.
    #[inline]
    pub fn cross_force(self, f: Force) -> Force {
        Force::new(
            self.angular.cross(&f.linear),
            self.angular.cross(&f.angular) + self.linear.cross(&f.linear),
        )
    }
    /// Power of a wrench, W, or `S^T f`.
    #[inline]
    pub fn dot(self, f: Force) -> f64 {
        self.linear.dot(&f.linear) + self.angular.dot(&f.angular)
    }
}

/// Placement of a frame B in a frame A: `x_A = rotation x_B + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se3 {
    /// `R`, axes of B in A (3×3).
    pub rotation: Matrix3<f64>,
    /// `p`, origin of B in A, m (3).
    pub translation: Vector3<f64>,
}

impl Se3 {
    /// From rotation matrix and translation.
    #[inline]
    pub fn new(rotation: Matrix3<f64>, translation: Vector3<f64>) -> Self {
        Self {
            rotation,
            translation,
        }
    }
    /// The same frame.
    #[inline]
    pub fn identity() -> Self {
        Self::new(Matrix3::identity(), Vector3::zeros())
    }
    /// From a translation and URDF's roll, pitch, yaw about fixed axes, rad.
    pub fn from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        let rotation = Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]);
        Self::new(rotation.into_inner(), Vector3::from(xyz))
    }
    /// `A_B · B_C = A_C`.
    #[inline]
    pub fn compose(&self, o: &Se3) -> Se3 {
        Se3::new(
            self.rotation * o.rotation,
            self.rotation * o.translation + self.translation,
        )
    }
    /// Placement of A in B.
    #[inline]
    pub fn inverse(&self) -> Se3 {
        let r = self.rotation.transpose();
        Se3::new(r, -(r * self.translation))
    }
    /// A point of B in A.
    #[inline]
    pub fn act_point(&self, p: Vector3<f64>) -> Vector3<f64> {
        self.rotation * p + self.translation
    }
    /// A motion of B in A.
    #[inline]
    pub fn act_motion(&self, m: Motion) -> Motion {
        let angular = self.rotation * m.angular;
        Motion::new(
            self.rotation * m.linear + self.translation.cross(&angular),
            angular,
        )
    }
    /// A motion of A in B.
    #[inline]
    pub fn inverse_act_motion(&self, m: Motion) -> Motion {
        Motion::new(
            self.rotation
                .tr_mul(&(m.linear - self.translation.cross(&m.angular))),
            self.rotation.tr_mul(&m.angular),
        )
    }
    /// A wrench of B in A.
    #[inline]
    pub fn act_force(&self, f: Force) -> Force {
        let linear = self.rotation * f.linear;
        Force::new(
            linear,
            self.rotation * f.angular + self.translation.cross(&linear),
        )
    }
    /// A wrench of A in B.
    #[inline]
    pub fn inverse_act_force(&self, f: Force) -> Force {
        Force::new(
            self.rotation.tr_mul(&f.linear),
            self.rotation
                .tr_mul(&(f.angular - self.translation.cross(&f.linear))),
        )
    }
}

/// Spatial inertia of a rigid body: mass, first moment and rotational inertia at the frame's origin.
///
/// Unlike mass, centre and central inertia, these ten numbers add up, and stay meaningful for a
/// part without mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// `m`, kg.
    pub mass: f64,
    /// `m c`, kg·m (3).
    pub first_moment: Vector3<f64>,
    /// `I_O`, about the origin, kg·m² (3×3, symmetric).
    pub rotational: Matrix3<f64>,
}

impl Inertia {
    /// No mass at all.
    pub fn zero() -> Self {
        Self {
            mass: 0.0,
            first_moment: Vector3::zeros(),
            rotational: Matrix3::zeros(),
        }
    }
    /// From mass, centre of mass and the inertia about the centre of mass.
    pub fn from_central(mass: f64, center: Vector3<f64>, central: Matrix3<f64>) -> Self {
        Self {
            mass,
            first_moment: center * mass,
            rotational: central + parallel_axis(mass, &center),
        }
    }
    /// `c`, centre of mass, m; zero for a part without mass.
    pub fn center(&self) -> Vector3<f64> {
        if self.mass > 0.0 {
            self.first_moment / self.mass
        } else {
            Vector3::zeros()
        }
    }
    /// `I_C`, inertia about the centre of mass, kg·m².
    pub fn central(&self) -> Matrix3<f64> {
        self.rotational - parallel_axis(self.mass, &self.center())
    }
    /// The inertia of B in A.
    #[inline]
    pub fn transformed(&self, a_b: &Se3) -> Inertia {
        let (r, p) = (&a_b.rotation, &a_b.translation);
        let h = r * self.first_moment;
        // I_A = R I_B R^T - [p][h] - [h + m p][p]
        let outer = p * h.transpose() + (h + p * self.mass) * p.transpose();
        let rotated = r * self.rotational * r.transpose();
        let trace = outer[(0, 0)] + outer[(1, 1)] + outer[(2, 2)];
        // -[a][b] = (a·b) 1 - b a^T; the sum is symmetric
        let rotational = rotated + Matrix3::from_diagonal_element(trace) - outer.transpose();
        Inertia {
            mass: self.mass,
            first_moment: h + p * self.mass,
            rotational,
        }
    }
    /// Wrench that gives the body the acceleration `a` while it moves with `v`: `I a + v ×* I v`.
    #[inline]
    pub fn wrench(&self, v: Motion, a: Motion) -> Force {
        self.mul_motion(a) + v.cross_force(self.mul_motion(v))
    }
    /// Momentum of a twist, or wrench of an acceleration.
    #[inline]
    pub fn mul_motion(&self, v: Motion) -> Force {
        Force::new(
            v.linear * self.mass + v.angular.cross(&self.first_moment),
            self.rotational * v.angular + self.first_moment.cross(&v.linear),
        )
    }
}

impl std::ops::Add for Inertia {
    type Output = Inertia;
    #[inline]
    fn add(self, o: Inertia) -> Inertia {
        Inertia {
            mass: self.mass + o.mass,
            first_moment: self.first_moment + o.first_moment,
            rotational: self.rotational + o.rotational,
        }
    }
}

impl std::ops::AddAssign for Inertia {
    #[inline]
    fn add_assign(&mut self, o: Inertia) {
        *self = *self + o;
    }
}

impl std::ops::Sub for Inertia {
    type Output = Inertia;
    #[inline]
    fn sub(self, o: Inertia) -> Inertia {
        Inertia {
            mass: self.mass - o.mass,
            first_moment: self.first_moment - o.first_moment,
            rotational: self.rotational - o.rotational,
        }
    }
}

/// `m (c·c 1 - c c^T)`.
fn parallel_axis(mass: f64, c: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::from_diagonal_element(c.dot(c)) - c * c.transpose()) * mass
}
