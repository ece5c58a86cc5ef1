//! Inertias of pieces in the root's axes, and the wrenches that they need, four pieces at a time.

use crate::layout::Piece;
use dynamics::{Force, Inertia, Motion, Se3};
use nalgebra::{Matrix3, Vector3};
use simd::{Instructions, Kernel, Lanes, M3, Pack, V3, WIDTH, store_all};

/// Constants of all pieces, in groups of four.
#[derive(Debug, Clone)]
pub(crate) struct Pieces {
    groups: Vec<Group>,
    instructions: Instructions,
}

/// Constants of four pieces; those beyond the last one have no mass.
#[derive(Debug, Clone, Default)]
struct Group {
    bodies: [usize; WIDTH],
    mass: Pack,
    first_moment: [Pack; 3],
    /// xx xy xz yy yz zz.
    rotational: [Pack; 6],
}

impl Pieces {
    pub(crate) fn new(pieces: &[Piece]) -> Self {
        let group = |four: &[Piece]| {
            let mut group = Group::default();
            for (lane, piece) in four.iter().enumerate() {
                let Inertia {
                    mass,
                    first_moment: h,
                    rotational: i,
                } = piece.inertia;
                group.bodies[lane] = piece.body;
                group.mass.0[lane] = mass;
                for k in 0..3 {
                    group.first_moment[k].0[lane] = h[k];
                }
                let upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
                for (pack, at) in group.rotational.iter_mut().zip(upper) {
                    pack.0[lane] = i[at];
                }
            }
            group
        };
        Self {
            groups: pieces.chunks(WIDTH).map(group).collect(),
            instructions: Instructions::detect(),
        }
    }

    /// Inertias and wrenches of all pieces, from placement, twist and proper acceleration of each
    /// body in the root's axes.
    pub(crate) fn update(
        &self,
        placements: &[Se3],
        velocities: &[Motion],
        accelerations: &[Motion],
        inertias: &mut [Inertia],
        wrenches: &mut [Force],
    ) {
        let update = Update {
            groups: &self.groups,
            placements,
            velocities,
            accelerations,
            inertias,
            wrenches,
        };
        simd::run(self.instructions, update);
    }
}

struct Update<'a> {
    groups: &'a [Group],
    placements: &'a [Se3],
    velocities: &'a [Motion],
    accelerations: &'a [Motion],
    inertias: &'a mut [Inertia],
    wrenches: &'a mut [Force],
}

impl Kernel for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let inertias = self.inertias.chunks_mut(WIDTH);
        let wrenches = self.wrenches.chunks_mut(WIDTH);
        for ((group, inertias), wrenches) in self.groups.iter().zip(inertias).zip(wrenches) {
            let [a, b, c, d] = group.bodies;
            let (r, p) = placement([a, b, c, d].map(|i| &self.placements[i]));
            let twist: [V3<L>; 2] = motion([a, b, c, d].map(|i| &self.velocities[i]));
            let acceleration = motion([a, b, c, d].map(|i| &self.accelerations[i]));

            let mass = L::load(&group.mass);
            let h = r.times_vector(V3::load(&group.first_moment));
            let moment = h.add_scaled(mass, p);
            // I_A = R I_B R^T - [p][h] - [h + m p][p], with -[a][b] = (a·b) 1 - b a^T
            let trace = p.dot_add(h, p.dot(moment));
            let i = M3::load_symmetric(&group.rotational).rotated(r);
            let mut i = i.sub_outer(h, p).sub_outer(p, moment);
            i.0.x = i.0.x + trace;
            i.1.y = i.1.y + trace;
            i.2.z = i.2.z + trace;

            //= D Algorithm 1: f_i = I_i a_i + v_i x* I_i v_i
            let [force, torque] = times(mass, moment, i, acceleration);
            let [linear, angular] = times(mass, moment, i, twist);
            let [v, omega] = twist;
            let force = omega.cross_add(linear, force);
            let torque = v.cross_add(linear, omega.cross_add(angular, torque));

            let (mut h, mut n) = ([Pack::ZERO; 3], [Pack::ZERO; 6]);
            let mut rotational = [Pack::ZERO; 6];
            moment.store(&mut h);
            store_all(i.upper(), &mut rotational);
            store_all(
                [force.x, force.y, force.z, torque.x, torque.y, torque.z],
                &mut n,
            );
            for (lane, (inertia, wrench)) in inertias.iter_mut().zip(wrenches).enumerate() {
                let of = |pack: &Pack| pack.0[lane % WIDTH];
                let [xx, xy, xz, yy, yz, zz] = &rotational;
                let (xy, xz, yz) = (of(xy), of(xz), of(yz));
                inertia.mass = of(&group.mass);
                inertia.first_moment = Vector3::new(of(&h[0]), of(&h[1]), of(&h[2]));
                inertia.rotational = Matrix3::new(of(xx), xy, xz, xy, of(yy), yz, xz, yz, of(zz));
                wrench.linear = Vector3::new(of(&n[0]), of(&n[1]), of(&n[2]));
                wrench.angular = Vector3::new(of(&n[3]), of(&n[4]), of(&n[5]));
            }
        }
    }
}

/// Wrench of an acceleration, or momentum of a twist.
#[inline(always)]
fn times<L: Lanes>(
    mass: L,
    moment: V3<L>,
    rotational: M3<L>,
    [v, omega]: [V3<L>; 2],
) -> [V3<L>; 2] {
    [
        omega.cross_add(moment, v.scale(mass)),
        rotational.mul_add(omega, moment.cross(v)),
    ]
}

/// Rotation and origin.
#[inline(always)]
fn placement<L: Lanes>(four: [&Se3; WIDTH]) -> (M3<L>, V3<L>) {
    let [a, b, c, d] = four;
    let origins = [
        &a.translation,
        &b.translation,
        &c.translation,
        &d.translation,
    ];
    let [a, b, c, d] = four.map(|placement| &placement.rotation.data.0);
    // Columns are stored side by side.
    let columns = M3(
        numbers([&a[0], &b[0], &c[0], &d[0]]),
        numbers([&a[1], &b[1], &c[1], &d[1]]),
        numbers([&a[2], &b[2], &c[2], &d[2]]),
    );
    (columns.transpose(), vector(origins))
}

/// Linear and angular part.
#[inline(always)]
fn motion<L: Lanes>(four: [&Motion; WIDTH]) -> [V3<L>; 2] {
    let [a, b, c, d] = four;
    [
        vector([&a.linear, &b.linear, &c.linear, &d.linear]),
        vector([&a.angular, &b.angular, &c.angular, &d.angular]),
    ]
}

#[inline(always)]
fn vector<L: Lanes>(four: [&Vector3<f64>; WIDTH]) -> V3<L> {
    let [a, b, c, d] = four.map(|vector| &vector.data.0[0]);
    numbers([a, b, c, d])
}

#[inline(always)]
fn numbers<L: Lanes>([a, b, c, d]: [&[f64; 3]; WIDTH]) -> V3<L> {
    V3::new(
        L::set([a[0], b[0], c[0], d[0]]),
        L::set([a[1], b[1], c[1], d[1]]),
        L::set([a[2], b[2], c[2], d[2]]),
    )
}
