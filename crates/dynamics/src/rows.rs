//! Intermediate values of the algorithms that run on the lane schedule, four bodies a row; the
//! root has row 0.

use simd::{Pack, WIDTH};

/// `rnea`: motion and wrench of four bodies, in their lane frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct RneaRow {
    pub(crate) omega: [Pack; 3],
    pub(crate) alpha: [Pack; 3],
    /// Of the origin, minus gravity.
    pub(crate) a: [Pack; 3],
    /// `U`, by rows.
    pub(crate) u: [Pack; 9],
    /// Wrench of the joint, moment about the origin.
    pub(crate) f: [Pack; 3],
    pub(crate) n: [Pack; 3],
    pub(crate) cos: Pack,
    pub(crate) sin: Pack,
    /// Origin in the parent's lane frame, where a joint may be prismatic.
    pub(crate) arm: [Pack; 3],
}

/// `aba`: four bodies, in their lane frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct AbaRow {
    pub(crate) cos: Pack,
    pub(crate) sin: Pack,
    pub(crate) omega: [Pack; 3],
    /// Origin in the parent's lane frame.
    pub(crate) arm: [Pack; 3],
    /// Acceleration at `ddq = 0` of a body whose parent does not accelerate.
    pub(crate) bias_a: [Pack; 3],
    pub(crate) bias_alpha: [Pack; 3],
    /// Articulated inertia: `M` and `I` as xx xy xz yy yz zz, `H` by rows.
    pub(crate) m: [Pack; 6],
    pub(crate) h: [Pack; 9],
    pub(crate) i: [Pack; 6],
    /// Articulated bias wrench.
    pub(crate) f: [Pack; 3],
    pub(crate) n: [Pack; 3],
    /// Wrench for unit acceleration of the joint, the inverse of its part along the joint's axis,
    /// and the torque that accelerates it.
    pub(crate) u_f: [Pack; 3],
    pub(crate) u_n: [Pack; 3],
    pub(crate) inverse_d: Pack,
    pub(crate) u: Pack,
    pub(crate) a: [Pack; 3],
    pub(crate) alpha: [Pack; 3],
}

/// `crba`: four bodies, in the root's axes and at its origin.
#[derive(Clone, Debug)]
pub(crate) struct CrbaRow {
    /// From the lane frame to the root's, by rows.
    pub(crate) rotation: [Pack; 9],
    pub(crate) translation: [Pack; 3],
    /// Of the sub-tree: mass, first and second moments.
    pub(crate) mass: Pack,
    pub(crate) h: [Pack; 3],
    pub(crate) s: [Pack; 6],
    /// Twist of the joint for unit speed, linear first.
    pub(crate) twist: [Pack; 6],
    /// Momentum that it gives the sub-tree.
    pub(crate) momentum: [Pack; 6],
}

impl CrbaRow {
    pub(crate) const ROOT: CrbaRow = {
        let one = Pack([1.0; WIDTH]);
        let o = Pack::ZERO;
        CrbaRow {
            rotation: [one, o, o, o, one, o, o, o, one],
            translation: [o; 3],
            mass: o,
            h: [o; 3],
            s: [o; 6],
            twist: [o; 6],
            momentum: [o; 6],
        }
    };
}
