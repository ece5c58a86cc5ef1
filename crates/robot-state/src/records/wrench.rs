//! Force and torque at one point.

use crate::layout::record;

record! {
    /// A force and a torque at one point, in that point's axes.
    pub struct Wrench {
        /// f: force, N, x y z.
        pub force: [f64; 3],
        /// n: torque about the frame's origin, N·m, x y z.
        pub torque: [f64; 3],
    }
}

impl Wrench {
    /// Force, then torque.
    #[must_use]
    pub const fn to_array(&self) -> [f64; 6] {
        let ([fx, fy, fz], [tx, ty, tz]) = (self.force, self.torque);
        [fx, fy, fz, tx, ty, tz]
    }

    /// Of force, then torque.
    #[must_use]
    pub const fn from_array([fx, fy, fz, tx, ty, tz]: [f64; 6]) -> Self {
        Self {
            force: [fx, fy, fz],
            torque: [tx, ty, tz],
        }
    }
}
