//! Three-vectors of lanes.

use crate::{Lanes, Pack, WIDTH};

/// One three-vector per lane.
#[derive(Clone, Copy)]
pub struct V3<L> {
    /// First component.
    pub x: L,
    /// Second component.
    pub y: L,
    /// Third component.
    pub z: L,
}

impl<L: Lanes> V3<L> {
    /// From components.
    #[inline(always)]
    pub fn new(x: L, y: L, z: L) -> Self {
        Self { x, y, z }
    }
    /// From memory.
    #[inline(always)]
    pub fn load(p: &[Pack; 3]) -> Self {
        Self::new(L::load(&p[0]), L::load(&p[1]), L::load(&p[2]))
    }
    /// To memory.
    #[inline(always)]
    pub fn store(self, p: &mut [Pack; 3]) {
        self.x.store(&mut p[0]);
        self.y.store(&mut p[1]);
        self.z.store(&mut p[2]);
    }
    /// `self + o`.
    #[inline(always)]
    pub fn plus(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
    /// `k self`.
    #[inline(always)]
    pub fn scale(self, k: L) -> Self {
        Self::new(self.x * k, self.y * k, self.z * k)
    }
    /// `self + k o`.
    #[inline(always)]
    pub fn add_scaled(self, k: L, o: Self) -> Self {
        Self::new(
            k.mul_add(o.x, self.x),
            k.mul_add(o.y, self.y),
            k.mul_add(o.z, self.z),
        )
    }
    /// `self - k o`.
    #[inline(always)]
    pub fn sub_scaled(self, k: L, o: Self) -> Self {
        Self::new(
            k.neg_mul_add(o.x, self.x),
            k.neg_mul_add(o.y, self.y),
            k.neg_mul_add(o.z, self.z),
        )
    }
    /// `self · o`.
    #[inline(always)]
    pub fn dot(self, o: Self) -> L {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }
    /// `b + self · o`.
    #[inline(always)]
    pub fn dot_add(self, o: Self, b: L) -> L {
        self.x
            .mul_add(o.x, self.y.mul_add(o.y, self.z.mul_add(o.z, b)))
    }
    /// `self × o`.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self::new(
            self.z.neg_mul_add(o.y, self.y * o.z),
            self.x.neg_mul_add(o.z, self.z * o.x),
            self.y.neg_mul_add(o.x, self.x * o.y),
        )
    }
    /// `b + self × o`.
    #[inline(always)]
    pub fn cross_add(self, o: Self, b: Self) -> Self {
        Self::new(
            self.z.neg_mul_add(o.y, self.y.mul_add(o.z, b.x)),
            self.x.neg_mul_add(o.z, self.z.mul_add(o.x, b.y)),
            self.y.neg_mul_add(o.x, self.x.mul_add(o.y, b.z)),
        )
    }
    /// Rotated about x by the angle of cosine `c` and sine `s`.
    #[inline(always)]
    pub fn rotate_x(self, c: L, s: L) -> Self {
        Self::new(
            self.x,
            s.neg_mul_add(self.z, c * self.y),
            s.mul_add(self.y, c * self.z),
        )
    }
    /// Rotated back about x.
    #[inline(always)]
    pub fn rotate_back_x(self, c: L, s: L) -> Self {
        Self::new(
            self.x,
            s.mul_add(self.z, c * self.y),
            s.neg_mul_add(self.y, c * self.z),
        )
    }
    /// Rotated about z by the angle of cosine `c` and sine `s`.
    #[inline(always)]
    pub fn rotate_z(self, c: L, s: L) -> Self {
        Self::new(
            s.neg_mul_add(self.y, c * self.x),
            s.mul_add(self.x, c * self.y),
            self.z,
        )
    }
    /// Rotated back about z.
    #[inline(always)]
    pub fn rotate_back_z(self, c: L, s: L) -> Self {
        Self::new(
            s.mul_add(self.y, c * self.x),
            s.neg_mul_add(self.x, c * self.y),
            self.z,
        )
    }
}

/// Places of four values: row and lane of each.
pub type Places = [(usize, usize); WIDTH];

impl<L: Lanes> V3<L> {
    /// One vector from each of four places; `vectors` are those of the four rows.
    #[inline(always)]
    pub fn pick(vectors: [&[Pack; 3]; WIDTH], places: &Places) -> Self {
        Self::new(
            pick(vectors[0], vectors[1], vectors[2], vectors[3], places, 0),
            pick(vectors[0], vectors[1], vectors[2], vectors[3], places, 1),
            pick(vectors[0], vectors[1], vectors[2], vectors[3], places, 2),
        )
    }
}

impl<L: Lanes> V3<L> {
    /// Two vectors, linear then angular, from each of four places.
    #[inline(always)]
    pub fn pick_pair(six: [&[Pack; 6]; WIDTH], places: &Places) -> (Self, Self) {
        let [a, b, c, d] = six;
        (
            Self::new(
                pick(a, b, c, d, places, 0),
                pick(a, b, c, d, places, 1),
                pick(a, b, c, d, places, 2),
            ),
            Self::new(
                pick(a, b, c, d, places, 3),
                pick(a, b, c, d, places, 4),
                pick(a, b, c, d, places, 5),
            ),
        )
    }
}

/// Number `k` of each of four places.
#[inline(always)]
pub(crate) fn pick<L: Lanes, const N: usize>(
    a: &[Pack; N],
    b: &[Pack; N],
    c: &[Pack; N],
    d: &[Pack; N],
    places: &Places,
    k: usize,
) -> L {
    L::set([
        a[k].0[places[0].1 % WIDTH],
        b[k].0[places[1].1 % WIDTH],
        c[k].0[places[2].1 % WIDTH],
        d[k].0[places[3].1 % WIDTH],
    ])
}

/// Adds the lanes of `values` to four places of a row's numbers.
#[inline(always)]
pub fn scatter_add<L: Lanes, R, const N: usize>(
    values: [L; N],
    rows: &mut [R],
    places: &Places,
    numbers: fn(&mut R) -> [&mut Pack; N],
) {
    let mut packs = [Pack::ZERO; N];
    store_all(values, &mut packs);
    for (from, (row, lane)) in places.iter().enumerate() {
        for (to, pack) in numbers(&mut rows[*row]).into_iter().zip(&packs) {
            to.0[*lane % WIDTH] += pack.0[from];
        }
    }
}

/// Several numbers to memory. (By index: iterators would leave the instruction set.)
#[inline(always)]
pub fn store_all<L: Lanes, const N: usize>(x: [L; N], p: &mut [Pack; N]) {
    let mut k = 0;
    while k < N {
        x[k].store(&mut p[k]);
        k += 1;
    }
}

/// Several numbers from memory.
#[inline(always)]
pub fn load_all<L: Lanes, const N: usize>(p: &[Pack; N]) -> [L; N] {
    let mut x = [L::splat(0.0); N];
    let mut k = 0;
    while k < N {
        x[k] = L::load(&p[k]);
        k += 1;
    }
    x
}
