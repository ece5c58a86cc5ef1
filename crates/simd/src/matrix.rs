//! Three-by-three matrices of lanes.

use crate::vector::pick;
use crate::{Lanes, Pack, Places, V3, WIDTH};

/// Three by three numbers per lane, by rows.
#[derive(Clone, Copy)]
pub struct M3<L>(pub V3<L>, pub V3<L>, pub V3<L>);

impl<L: Lanes> M3<L> {
    /// From memory, by rows.
    #[inline(always)]
    pub fn load(p: &[Pack; 9]) -> Self {
        M3(
            V3::new(L::load(&p[0]), L::load(&p[1]), L::load(&p[2])),
            V3::new(L::load(&p[3]), L::load(&p[4]), L::load(&p[5])),
            V3::new(L::load(&p[6]), L::load(&p[7]), L::load(&p[8])),
        )
    }
    /// To memory, by rows.
    #[inline(always)]
    pub fn store(self, p: &mut [Pack; 9]) {
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
    /// One matrix from each of four places; `matrices` are those of the four rows.
    #[inline(always)]
    pub fn pick(matrices: [&[Pack; 9]; WIDTH], places: &Places) -> Self {
        let [a, b, c, d] = matrices;
        M3(
            V3::new(
                pick(a, b, c, d, places, 0),
                pick(a, b, c, d, places, 1),
                pick(a, b, c, d, places, 2),
            ),
            V3::new(
                pick(a, b, c, d, places, 3),
                pick(a, b, c, d, places, 4),
                pick(a, b, c, d, places, 5),
            ),
            V3::new(
                pick(a, b, c, d, places, 6),
                pick(a, b, c, d, places, 7),
                pick(a, b, c, d, places, 8),
            ),
        )
    }
    /// A symmetric matrix, from xx xy xz yy yz zz.
    #[inline(always)]
    pub fn load_symmetric(p: &[Pack; 6]) -> Self {
        let (xy, xz, yz) = (L::load(&p[1]), L::load(&p[2]), L::load(&p[4]));
        M3(
            V3::new(L::load(&p[0]), xy, xz),
            V3::new(xy, L::load(&p[3]), yz),
            V3::new(xz, yz, L::load(&p[5])),
        )
    }
    /// xx xy xz yy yz zz.
    #[inline(always)]
    pub fn upper(self) -> [L; 6] {
        [self.0.x, self.0.y, self.0.z, self.1.y, self.1.z, self.2.z]
    }
    /// `trace 1 - self`.
    #[inline(always)]
    pub fn trace_minus(self) -> Self {
        M3(
            V3::new(self.1.y + self.2.z, -self.0.y, -self.0.z),
            V3::new(-self.1.x, self.0.x + self.2.z, -self.1.z),
            V3::new(-self.2.x, -self.2.y, self.0.x + self.1.y),
        )
    }
    /// `self^T`.
    #[inline(always)]
    pub fn transpose(self) -> Self {
        M3(
            V3::new(self.0.x, self.1.x, self.2.x),
            V3::new(self.0.y, self.1.y, self.2.y),
            V3::new(self.0.z, self.1.z, self.2.z),
        )
    }
    /// `self m`.
    #[inline(always)]
    pub fn times(self, m: Self) -> Self {
        M3(m.tr_mul(self.0), m.tr_mul(self.1), m.tr_mul(self.2))
    }
    /// `self + m`.
    #[inline(always)]
    pub fn plus(self, m: Self) -> Self {
        M3(self.0.plus(m.0), self.1.plus(m.1), self.2.plus(m.2))
    }
    /// `self - a b^T`.
    #[inline(always)]
    pub fn sub_outer(self, a: V3<L>, b: V3<L>) -> Self {
        M3(
            self.0.sub_scaled(a.x, b),
            self.1.sub_scaled(a.y, b),
            self.2.sub_scaled(a.z, b),
        )
    }
    /// `self + a b^T`.
    #[inline(always)]
    pub fn add_outer(self, a: V3<L>, b: V3<L>) -> Self {
        M3(
            self.0.add_scaled(a.x, b),
            self.1.add_scaled(a.y, b),
            self.2.add_scaled(a.z, b),
        )
    }
    /// `[r] self`: `r ×` each column.
    #[inline(always)]
    pub fn cross_columns(self, r: V3<L>) -> Self {
        M3(
            self.2.scale(r.y).sub_scaled(r.z, self.1),
            self.0.scale(r.z).sub_scaled(r.x, self.2),
            self.1.scale(r.x).sub_scaled(r.y, self.0),
        )
    }
    /// `self Rz`.
    #[inline(always)]
    pub fn times_rotation_z(self, c: L, s: L) -> Self {
        M3(
            self.0.rotate_back_z(c, s),
            self.1.rotate_back_z(c, s),
            self.2.rotate_back_z(c, s),
        )
    }
    /// `self Rx`.
    #[inline(always)]
    pub fn times_rotation_x(self, c: L, s: L) -> Self {
        M3(
            self.0.rotate_back_x(c, s),
            self.1.rotate_back_x(c, s),
            self.2.rotate_back_x(c, s),
        )
    }
    /// `Rz self Rz^T`.
    #[inline(always)]
    pub fn rotated_z(self, c: L, s: L) -> Self {
        let m = M3(
            self.0.scale(c).sub_scaled(s, self.1),
            self.1.scale(c).add_scaled(s, self.0),
            self.2,
        );
        M3(m.0.rotate_z(c, s), m.1.rotate_z(c, s), m.2.rotate_z(c, s))
    }
    /// `Rx self Rx^T`.
    #[inline(always)]
    pub fn rotated_x(self, c: L, s: L) -> Self {
        let m = M3(
            self.0,
            self.1.scale(c).sub_scaled(s, self.2),
            self.2.scale(c).add_scaled(s, self.1),
        );
        M3(m.0.rotate_x(c, s), m.1.rotate_x(c, s), m.2.rotate_x(c, s))
    }
    /// `r self r^T`.
    #[inline(always)]
    pub fn rotated(self, r: Self) -> Self {
        r.times(self).times(r.transpose())
    }
    /// `self x`.
    #[inline(always)]
    pub fn times_vector(self, x: V3<L>) -> V3<L> {
        V3::new(self.0.dot(x), self.1.dot(x), self.2.dot(x))
    }
    /// `b + self x`.
    #[inline(always)]
    pub fn mul_add(self, x: V3<L>, b: V3<L>) -> V3<L> {
        V3::new(
            self.0.dot_add(x, b.x),
            self.1.dot_add(x, b.y),
            self.2.dot_add(x, b.z),
        )
    }
    /// `self^T x`.
    #[inline(always)]
    pub fn tr_mul(self, x: V3<L>) -> V3<L> {
        self.0
            .scale(x.x)
            .add_scaled(x.y, self.1)
            .add_scaled(x.z, self.2)
    }
    /// The last column.
    #[inline(always)]
    pub fn third_column(self) -> V3<L> {
        V3::new(self.0.z, self.1.z, self.2.z)
    }
}
