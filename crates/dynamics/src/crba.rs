//! Composite rigid bodies: the joint-space mass matrix.

use crate::data::Data;
use crate::kinematics::forward_kinematics;
use crate::model::{Base, Model};
use crate::spatial::{Force, Motion};
use nalgebra::DMatrix;

/// `M(q)` (nv × nv), symmetric, armature included.
pub fn crba<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d DMatrix<f64> {
    forward_kinematics(model, data, q);
    let base = model.base_size().0;
    for (i, body) in model.bodies.iter().enumerate() {
        data.composite[i] = body.inertia;
    }
    let m = &mut data.mass_matrix;
    m.fill(0.0);
    for (i, body) in model.bodies.iter().enumerate().skip(1).rev() {
        let on_parent = data.composite[i].transformed(&data.in_parent[i]);
        data.composite[body.parent] += on_parent;
        let column = base + body.joint;
        let mut f = data.composite[i].mul_motion(body.subspace()) * body.ratio;
        m[(column, column)] += body.ratio * body.along_axis(f);
        let mut k = i;
        while k != 0 {
            f = data.in_parent[k].act_force(f);
            k = model.bodies[k].parent;
            if k == 0 {
                break;
            }
            let ancestor = &model.bodies[k];
            let row = base + ancestor.joint;
            let x = ancestor.ratio * ancestor.along_axis(f);
            m[(row, column)] += x;
            m[(column, row)] += x;
        }
        if model.base == Base::Floating {
            add_base(m, column, f);
        }
    }
    for (i, joint) in model.joints.iter().enumerate() {
        m[(base + i, base + i)] += joint.armature;
    }
    if model.base == Base::Floating {
        for k in 0..6 {
            let mut unit = [0.0; 6];
            unit[k] = 1.0;
            let f = data.composite[0].mul_motion(Motion::from_array(unit));
            for (row, x) in f.to_array().into_iter().enumerate() {
                m[(row, k)] = x;
            }
        }
    }
    &data.mass_matrix
}

/// Coupling of a joint with the six components of the base.
fn add_base(m: &mut DMatrix<f64>, column: usize, f: Force) {
    for (row, x) in f.to_array().into_iter().enumerate() {
        m[(row, column)] += x;
        m[(column, row)] += x;
    }
}
