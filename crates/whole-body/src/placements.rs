//! Placements and joint axes of all bodies in the root's frame.
//!
//! A joint's rotation in its parent is `A + B sin q + C cos q` with constant matrices (Rodrigues), so
//! sines come four at a time, and a body costs the product with its parent's placement, whose columns
//! lie side by side in lanes.

use dynamics::{Model, Motion, Se3};
use nalgebra::{Matrix3, Vector3};
use simd::{Instructions, Kernel, Lanes, Pack, WIDTH};

/// Constants of all bodies, and the memory to place them.
#[derive(Debug, Clone)]
pub(crate) struct Placements {
    moving: Vec<Moving>,
    /// Per body: rotation's columns and origin in the root's frame; a fourth lane is idle.
    columns: Vec<[Pack; 4]>,
    /// Per four bodies: sines and cosines of their angles.
    sines: Vec<[Pack; 2]>,
    instructions: Instructions,
}

/// Constants of one body's joint, in the axes of its parent. Columns have an idle fourth lane.
#[derive(Debug, Clone)]
struct Moving {
    parent: usize,
    joint: usize,
    ratio: f64,
    offset: f64,
    revolute: bool,
    /// Rotation: constant part, times the sine, times the cosine.
    rotation: [[Pack; 3]; 3],
    origin: [f64; 3],
    /// The joint's axis, and the same times the mimic ratio.
    axis: [f64; 3],
    scaled_axis: [f64; 3],
}

impl Moving {
    fn new(body: &dynamics::Body) -> Self {
        let (placement, axis) = (&body.placement, &body.axis);
        let r = placement.rotation;
        let (constant, sine, cosine) = if body.kind.is_revolute() {
            let along = r * axis * axis.transpose();
            (along, r * axis.cross_matrix(), r - along)
        } else {
            (r, Matrix3::zeros(), Matrix3::zeros())
        };
        let columns = |m: Matrix3<f64>| {
            [0, 1, 2].map(|column| Pack([m[(0, column)], m[(1, column)], m[(2, column)], 0.0]))
        };
        let axis = r * axis;
        Self {
            parent: body.parent,
            joint: body.joint,
            ratio: body.ratio,
            offset: body.offset,
            revolute: body.kind.is_revolute(),
            rotation: [constant, sine, cosine].map(columns),
            origin: placement.translation.into(),
            axis: axis.into(),
            scaled_axis: (axis * body.ratio).into(),
        }
    }
}

impl Placements {
    pub(crate) fn new(model: &Model) -> Self {
        let bodies = model.bodies();
        let column = |i: usize| {
            let mut column = Pack::ZERO;
            column.0[i] = 1.0;
            column
        };
        let root = [column(0), column(1), column(2), Pack::ZERO];
        Self {
            // The root does not move.
            moving: bodies.iter().skip(1).map(Moving::new).collect(),
            columns: vec![root; bodies.len()],
            sines: vec![[Pack::ZERO; 2]; bodies.len().div_ceil(WIDTH)],
            instructions: Instructions::detect(),
        }
    }

    /// Placement of each body in the root's frame, and its joint's axis (times a mimic joint's ratio)
    /// about the root's origin, at the model's joint angles `q`.
    pub(crate) fn update(&mut self, q: &[f64], in_root: &mut [Se3], axes: &mut [Motion]) {
        let place = Place {
            moving: &self.moving,
            columns: &mut self.columns,
            sines: &mut self.sines,
            q,
            in_root,
            axes,
        };
        simd::run(self.instructions, place);
    }
}

struct Place<'a> {
    moving: &'a [Moving],
    columns: &'a mut [[Pack; 4]],
    sines: &'a mut [[Pack; 2]],
    q: &'a [f64],
    in_root: &'a mut [Se3],
    axes: &'a mut [Motion],
}

impl Kernel for Place<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let position = |body: &Moving| self.q[body.joint] * body.ratio + body.offset;
        for (four, sines) in self.moving.chunks(WIDTH).zip(self.sines.iter_mut()) {
            let mut angles = [0.0; WIDTH];
            for (angle, body) in angles.iter_mut().zip(four) {
                *angle = if body.revolute { position(body) } else { 0.0 };
            }
            let (sin, cos) = simd::sin_cos(L::set(angles));
            sin.store(&mut sines[0]);
            cos.store(&mut sines[1]);
        }
        let outputs = self.in_root.iter_mut().zip(self.axes.iter_mut()).skip(1);
        for (i, (body, (in_root, axis))) in self.moving.iter().zip(outputs).enumerate() {
            let parent = self.columns[body.parent].each_ref().map(|c| L::load(c));
            let [x, y, z, p] = parent;
            let turned = |v: [f64; 3], from: L| {
                let [a, b, c] = v.map(L::splat);
                a.mul_add(x, b.mul_add(y, c.mul_add(z, from)))
            };
            let [sin, cos] = self.sines[i / WIDTH]
                .each_ref()
                .map(|four| L::splat(four.0[i % WIDTH]));
            let [constant, sine, cosine] = &body.rotation;
            let zero = L::splat(0.0);
            let mut origin = body.origin;
            if !body.revolute {
                let way = position(body);
                origin = std::array::from_fn(|k| origin[k] + body.axis[k] * way);
            }
            let own = &mut self.columns[i + 1];
            for k in 0..3 {
                let local = sin.mul_add(
                    L::load(&sine[k]),
                    cos.mul_add(L::load(&cosine[k]), L::load(&constant[k])),
                );
                let [x, y, z, _] = local.to_array();
                turned([x, y, z], zero).store(&mut own[k]);
            }
            let origin = turned(origin, p);
            origin.store(&mut own[3]);
            let direction = turned(body.scaled_axis, zero);
            let three = |x: &Pack| Vector3::new(x.0[0], x.0[1], x.0[2]);
            *in_root = Se3::new(
                Matrix3::from_columns(&[three(&own[0]), three(&own[1]), three(&own[2])]),
                three(&own[3]),
            );
            let mut moment = Pack::ZERO;
            origin.cross_in_lanes(direction).store(&mut moment);
            let direction = Pack(direction.to_array());
            *axis = if body.revolute {
                Motion::new(three(&moment), three(&direction))
            } else {
                Motion::new(three(&direction), Vector3::zeros())
            };
        }
    }
}
