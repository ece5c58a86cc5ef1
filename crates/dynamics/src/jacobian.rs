//! Jacobians of frames, after forward kinematics.

use crate::data::Data;
use crate::frames::{
    ReferenceFrame, frame_acceleration, frame_classical_acceleration, frame_placement,
};
use crate::model::{Base, Model};
use crate::spatial::{Motion, Se3};
use nalgebra::{Matrix6xX, Vector3};

/// `J` of a frame (6 × nv, linear rows first): its twist is `J v`.
///
/// `out` must have nv columns; those that do not move the frame are set to zero.
pub fn frame_jacobian(
    model: &Model,
    data: &Data,
    frame: usize,
    reference: ReferenceFrame,
    out: &mut Matrix6xX<f64>,
) {
    debug_assert_eq!(out.ncols(), model.nv());
    debug_assert!(frame < model.frames.len());
    out.fill(0.0);
    let Some(f) = model.frames.get(frame) else {
        return;
    };
    if out.ncols() < model.nv() {
        return;
    }
    let world_to = expressed_in(&frame_placement(model, data, frame), reference);
    let base = model.base_size().0;
    let mut add = |column: usize, m: Motion| {
        let m = world_to.act_motion(m).to_array();
        for (x, y) in out.column_mut(column).iter_mut().zip(m) {
            *x += y;
        }
    };
    let mut body = f.body;
    while let Some(parent) = model.parent(body) {
        let b = &model.bodies[body];
        add(
            base + b.joint,
            data.in_world[body].act_motion(b.subspace() * b.ratio),
        );
        body = parent;
    }
    if model.base == Base::Floating {
        for k in 0..6 {
            let mut unit = [0.0; 6];
            unit[k] = 1.0;
            add(k, data.in_world[0].act_motion(Motion::from_array(unit)));
        }
    }
}

/// Placement of the world in the axes and origin of `reference`, for a frame placed at `m`.
pub(crate) fn expressed_in(m: &Se3, reference: ReferenceFrame) -> Se3 {
    match reference {
        ReferenceFrame::World => Se3::identity(),
        ReferenceFrame::Local => m.inverse(),
        ReferenceFrame::LocalWorldAligned => {
            let back: Vector3<f64> = -m.translation;
            Se3::new(Se3::identity().rotation, back)
        }
    }
}

/// `dJ/dt v` of a frame: the rate of its twist (as `reference` expresses it) at `a = 0`.
///
/// After `forward_kinematics_acceleration` with `a = 0`.
pub fn frame_jacobian_rate_times_velocity(
    model: &Model,
    data: &Data,
    frame: usize,
    reference: ReferenceFrame,
) -> Motion {
    match reference {
        // The numbers of the twist at a moving origin in still axes change like a point's velocity.
        ReferenceFrame::LocalWorldAligned => {
            frame_classical_acceleration(model, data, frame, reference)
        }
        _ => frame_acceleration(model, data, frame, reference),
    }
}
