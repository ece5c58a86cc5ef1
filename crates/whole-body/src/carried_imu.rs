//! Carried IMU: what an IMU at one link shows of another link's motion, through the joints between them.

use dynamics::{Body, ImuMotion, Model, Motion, Se3};
use nalgebra::Vector3;

/// The way from one link of a robot to another.
#[derive(Debug, Clone)]
pub struct CarriedImu {
    /// The first link in its body.
    from: Se3,
    /// Joints on the way.
    steps: Vec<Step>,
    /// The last link in its body.
    to: Se3,
}

/// One joint on the way.
#[derive(Debug, Clone)]
struct Step {
    /// The body that it moves.
    body: Body,
    /// Index of the joint that drives it, among the caller's.
    joint: usize,
    /// The way leads to the body that carries it.
    inwards: bool,
}

impl CarriedImu {
    /// The way between two links; `joints`: names of the joints, in the order of angles in
    /// [`CarriedImu::motion`]. None if the model lacks a link, or a joint on the way is not among them.
    #[must_use]
    pub fn new(model: &Model, joints: &[&str], from: &str, to: &str) -> Option<Self> {
        let frame = |link: &str| model.frames().get(model.frame_index(link)?);
        let (from, to) = (frame(from)?, frame(to)?);
        let names: Vec<&str> = model.joint_names().collect();
        let step = |b: usize, inwards: bool| -> Option<Step> {
            let body = model.bodies().get(b)?.clone();
            let name = names.get(body.joint)?;
            Some(Step {
                joint: joints.iter().position(|joint| joint == name)?,
                body,
                inwards,
            })
        };
        let (mut steps, mut body) = (Vec::new(), from.body);
        while !model.supports(body, to.body) {
            steps.push(step(body, true)?);
            body = model.parent(body)?;
        }
        let (common, mut outwards, mut body) = (body, Vec::new(), to.body);
        while body != common {
            outwards.push(step(body, false)?);
            body = model.parent(body)?;
        }
        steps.extend(outwards.into_iter().rev());
        Some(Self {
            from: from.placement,
            steps,
            to: to.placement,
        })
    }

    /// The motion that an IMU at the last link would show, from that of one at the first link and the joints'
    /// angles, velocities and accelerations, rad, rad/s, rad/s² (m for prismatic joints).
    #[must_use]
    pub fn motion(&self, q: &[f64], dq: &[f64], ddq: &[f64], imu: &ImuMotion) -> ImuMotion {
        let of = |signal: &[f64], joint: usize| signal.get(joint).copied().unwrap_or(0.0);
        // A velocity of the whole robot has no effect: the first link's origin is taken to be at rest.
        let twist = Motion::new(Vector3::zeros(), imu.angular_velocity);
        let rate = Motion::new(imu.proper_acceleration, imu.angular_acceleration);
        let (mut v, mut a) = (self.from.act_motion(twist), self.from.act_motion(rate));
        for Step {
            body,
            joint,
            inwards,
        } in &self.steps
        {
            let placement = body.placement_at(of(q, *joint) * body.ratio + body.offset);
            let own = body.subspace() * body.ratio;
            let (velocity, acceleration) = (own * of(dq, *joint), own * of(ddq, *joint));
            if *inwards {
                a = placement.act_motion(a - acceleration - v.cross(velocity));
                v = placement.act_motion(v - velocity);
            } else {
                v = placement.inverse_act_motion(v) + velocity;
                a = placement.inverse_act_motion(a) + acceleration + v.cross(velocity);
            }
        }
        let (v, a) = (self.to.inverse_act_motion(v), self.to.inverse_act_motion(a));
        ImuMotion {
            angular_velocity: v.angular,
            angular_acceleration: a.angular,
            proper_acceleration: a.linear + v.angular.cross(&v.linear),
        }
    }
}
