//! Three-vectors of lanes.

use super::{Lanes, Pack};

/// One three-vector per lane.
#[derive(Clone, Copy)]
pub(crate) struct V3<L> {
    pub(crate) x: L,
    pub(crate) y: L,
    pub(crate) z: L,
}

impl<L: Lanes> V3<L> {
    #[inline(always)]
    pub(crate) fn new(x: L, y: L, z: L) -> Self {
        Self { x, y, z }
    }
    #[inline(always)]
    pub(crate) fn load(p: &[Pack; 3]) -> Self {
        Self::new(L::load(&p[0]), L::load(&p[1]), L::load(&p[2]))
    }
    #[inline(always)]
    pub(crate) fn store(self, p: &mut [Pack; 3]) {
        self.x.store(&mut p[0]);
        self.y.store(&mut p[1]);
        self.z.store(&mut p[2]);
    }
    #[inline(always)]
    pub(crate) fn add(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
    #[inline(always)]
    pub(crate) fn scale(self, k: L) -> Self {
        Self::new(self.x * k, self.y * k, self.z * k)
    }
    /// `self + k o`.
    #[inline(always)]
    pub(crate) fn add_scaled(self, k: L, o: Self) -> Self {
        Self::new(
            k.mul_add(o.x, self.x),
            k.mul_add(o.y, self.y),
            k.mul_add(o.z, self.z),
        )
    }
    #[inline(always)]
    pub(crate) fn dot(self, o: Self) -> L {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }
    /// `b + self · o`.
    #[inline(always)]
    pub(crate) fn dot_add(self, o: Self, b: L) -> L {
        self.x
            .mul_add(o.x, self.y.mul_add(o.y, self.z.mul_add(o.z, b)))
    }
    /// `b + self × o`.
    #[inline(always)]
    pub(crate) fn cross_add(self, o: Self, b: Self) -> Self {
        Self::new(
            self.z.neg_mul_add(o.y, self.y.mul_add(o.z, b.x)),
            self.x.neg_mul_add(o.z, self.z.mul_add(o.x, b.y)),
            self.y.neg_mul_add(o.x, self.x.mul_add(o.y, b.z)),
        )
    }
    /// Turned about x by the angle of cosine `c` and sine `s`.
    #[inline(always)]
    pub(crate) fn turn_x(self, c: L, s: L) -> Self {
        Self::new(
            self.x,
            s.neg_mul_add(self.z, c * self.y),
            s.mul_add(self.y, c * self.z),
        )
    }
    /// Turned back about x.
    #[inline(always)]
    pub(crate) fn turn_back_x(self, c: L, s: L) -> Self {
        Self::new(
            self.x,
            s.mul_add(self.z, c * self.y),
            s.neg_mul_add(self.y, c * self.z),
        )
    }
    /// Turned about z by the angle of cosine `c` and sine `s`.
    #[inline(always)]
    pub(crate) fn turn_z(self, c: L, s: L) -> Self {
        Self::new(
            s.neg_mul_add(self.y, c * self.x),
            s.mul_add(self.x, c * self.y),
            self.z,
        )
    }
    /// Turned back about z.
    #[inline(always)]
    pub(crate) fn turn_back_z(self, c: L, s: L) -> Self {
        Self::new(
            s.mul_add(self.y, c * self.x),
            s.neg_mul_add(self.x, c * self.y),
            self.z,
        )
    }
}

/// Three by three numbers per lane, by rows.
#[derive(Clone, Copy)]
pub(crate) struct M3<L>(pub(crate) V3<L>, pub(crate) V3<L>, pub(crate) V3<L>);

impl<L: Lanes> M3<L> {
    #[inline(always)]
    pub(crate) fn load(p: &[Pack; 9]) -> Self {
        M3(
            V3::new(L::load(&p[0]), L::load(&p[1]), L::load(&p[2])),
            V3::new(L::load(&p[3]), L::load(&p[4]), L::load(&p[5])),
            V3::new(L::load(&p[6]), L::load(&p[7]), L::load(&p[8])),
        )
    }
    #[inline(always)]
    pub(crate) fn store(self, p: &mut [Pack; 9]) {
        let [a, b, c, d, e, f, g, h, i] = p;
        self.0.x.store(a);
        self.0.y.store(b);
        self.0.z.store(c);
        self.1.x.store(d);
        self.1.y.store(e);
        self.1.z.store(f);
        self.2.x.store(g);
        self.2.y.store(h);
        self.2.z.store(i);
    }
    /// `self x`.
    #[inline(always)]
    pub(crate) fn mul(self, x: V3<L>) -> V3<L> {
        V3::new(self.0.dot(x), self.1.dot(x), self.2.dot(x))
    }
    /// `b + self x`.
    #[inline(always)]
    pub(crate) fn mul_add(self, x: V3<L>, b: V3<L>) -> V3<L> {
        V3::new(
            self.0.dot_add(x, b.x),
            self.1.dot_add(x, b.y),
            self.2.dot_add(x, b.z),
        )
    }
    /// `self^T x`.
    #[inline(always)]
    pub(crate) fn tr_mul(self, x: V3<L>) -> V3<L> {
        self.0
            .scale(x.x)
            .add_scaled(x.y, self.1)
            .add_scaled(x.z, self.2)
    }
    /// The last column.
    #[inline(always)]
    pub(crate) fn third_column(self) -> V3<L> {
        V3::new(self.0.z, self.1.z, self.2.z)
    }
}
