//! Placements, velocities and accelerations of frames, after forward kinematics.

use crate::data::Data;
use crate::model::Model;
use crate::spatial::{Motion, Se3};
use nalgebra::Vector3;

/// Axes and origin in which a frame's motion or Jacobian is expressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReferenceFrame {
    /// The frame's own axes and origin.
    Local,
    /// The world's axes and origin.
    World,
    /// The frame's origin, the world's axes.
    LocalWorldAligned,
}

/// `R, p`: placement of a frame in the world; the identity for a frame that does not exist.
pub fn frame_placement(model: &Model, data: &Data, frame: usize) -> Se3 {
    debug_assert!(frame < model.frames.len());
    match model.frames.get(frame) {
        Some(f) => data.in_world[f.body].compose(&f.placement),
        None => Se3::identity(),
    }
}

fn express(
    model: &Model,
    data: &Data,
    frame: usize,
    of_bodies: &[Motion],
    reference: ReferenceFrame,
) -> Motion {
    debug_assert!(frame < model.frames.len());
    let Some(f) = model.frames.get(frame) else {
        return Motion::zero();
    };
    let of_body = of_bodies[f.body];
    match reference {
        ReferenceFrame::World => data.in_world[f.body].act_motion(of_body),
        ReferenceFrame::Local => f.placement.inverse_act_motion(of_body),
        ReferenceFrame::LocalWorldAligned => {
            let local = f.placement.inverse_act_motion(of_body);
            let r = data.in_world[f.body].rotation * f.placement.rotation;
            Motion::new(r * local.linear, r * local.angular)
        }
    }
}

/// Twist of a frame.
pub fn frame_velocity(
    model: &Model,
    data: &Data,
    frame: usize,
    reference: ReferenceFrame,
) -> Motion {
    express(model, data, frame, &data.velocity, reference)
}

/// Spatial acceleration of a frame.
pub fn frame_acceleration(
    model: &Model,
    data: &Data,
    frame: usize,
    reference: ReferenceFrame,
) -> Motion {
    express(model, data, frame, &data.acceleration, reference)
}

/// Classical acceleration of a frame: its linear part is that of the point at the origin, which
/// an accelerometer there measures, less gravity.
pub fn frame_classical_acceleration(
    model: &Model,
    data: &Data,
    frame: usize,
    reference: ReferenceFrame,
) -> Motion {
    let v = frame_velocity(model, data, frame, reference);
    let mut a = frame_acceleration(model, data, frame, reference);
    let rotating: Vector3<f64> = v.angular.cross(&v.linear);
    a.linear += rotating;
    a
}
