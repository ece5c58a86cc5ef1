//! Frames: the springs, dampers and forces of the frames that a client leads.

use control::{CartesianLaw, CartesianTarget, Limb};
use dynamics::{Force, ReferenceFrame, Se3, crba, forward_kinematics};
use dynamics::{frame_jacobian, frame_placement};
use nalgebra::{Matrix3, Matrix6, Matrix6xX, UnitQuaternion, Vector6};
use robot_config::{FrameParameters, FtParameters, JointParameters, Parameters, Robot, TorqueLaw};
use robot_state::{
    CommandedRecord, EstimatedRecord, FrameCommanded, FrameReference, MeasuredRecord, Reference,
    Wrench,
};

use super::approach::Approaches;
use super::frame_check::{Placements, pose};
use crate::inputs::Seen;
use crate::mode::{Asked, Impedance, RigidBodyTorque};

/// Least share of a direction's lever in the limb's greatest one for which a force along it counts as known by external
/// torques. It would have twenty times the standard deviation.
const LEAST_LEVER: f64 = 0.05;

/// The frames of a robot.
#[derive(Debug)]
pub(super) struct Frames {
    placements: Option<Placements>,
    frames: Vec<Frame>,
    /// Frames that lead limbs in this mode.
    on: bool,
    /// Per joint, in config order: a led frame's limb has it.
    led: Vec<bool>,
    /// Velocity of each joint by its law, rad/s.
    dq: Vec<f64>,
    jacobian: Matrix6xX<f64>,
    sample_period: f64,
}

/// The environment's force on a frame as it is felt, N and N·m, and its delay, s.
#[derive(Debug, Clone, Copy, Default)]
struct Felt {
    force: Option<Vector6<f64>>,
    late: f64,
}

/// One frame with its law.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) parameters: FrameParameters,
    law: CartesianLaw,
    /// Frame of the F/T sensor that measures its forces.
    sensor: Option<(usize, usize)>,
    /// Delay of external torques behind the filters, s; none: there are none.
    external_delay: Option<f64>,
    /// Columns of the Jacobian, one for each joint of the limb.
    columns: Vec<Vector6<f64>>,
    dq: Vec<f64>,
    /// How fast a force moves each joint, and how stiff and damped the frame makes it.
    approach: Approaches,
    /// Inertia that each joint feels besides its links'.
    effective_inertia: Vec<f64>,
    /// Posture of each joint: its spring and its damper.
    posture: Vec<Impedance>,
    /// Lower triangle of the limb's mass matrix, then its Cholesky factor, by rows.
    factor: Vec<f64>,
    solved: Vec<Vector6<f64>>,
    started: bool,
}

impl Frames {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        Self {
            placements: (!p.frames.is_empty()).then(|| Placements::new(robot)),
            frames: p
                .frames
                .iter()
                .map(|frame| Frame::new(frame, robot))
                .collect(),
            on: false,
            led: vec![false; p.joints.len()],
            dq: vec![0.0; p.joints.len()],
            jacobian: Matrix6xX::zeros(robot.model.nv()),
            sample_period: p.timing.sample_period,
        }
    }

    /// A led frame's limb has the joint.
    pub(super) fn leads(&self, joint: usize) -> bool {
        self.on && self.led.get(joint) == Some(&true)
    }

    /// Share of the force's feedback that has been led to, 0 to 1, of frames that lead the joint and whose
    /// force an F/T sensor measures.
    pub(super) fn force_share(&self, joint: usize) -> f64 {
        if !self.leads(joint) {
            return 0.0;
        }
        let leads = |frame: &&Frame| frame.started && frame.parameters.joints.contains(&joint);
        let measured = self.frames.iter().filter(|f| f.sensor.is_some());
        let shares = measured.filter(leads).map(|f| f.law.force_share());
        shares.fold(0.0, f64::max)
    }

    /// Stiffness and damping of a joint besides those of frames: joints of a led limb keep their posture with
    /// no more than the configured share. `asked`: those of the client; none: the configured ones.
    pub(super) fn posture(&self, joint: usize, asked: Option<Impedance>) -> Option<Impedance> {
        if !self.leads(joint) {
            return asked;
        }
        let least = |a: Impedance, b: Impedance| Impedance {
            stiffness: a.stiffness.min(b.stiffness),
            damping: a.damping.min(b.damping),
        };
        let postures = self.frames.iter().filter_map(|frame| frame.posture(joint));
        asked.into_iter().chain(postures).reduce(least)
    }

    /// Nothing is led: the poses of the frames that a client uses are shown, if it uses any.
    pub(super) fn show(
        &mut self,
        client: Option<&Reference>,
        measured: &MeasuredRecord,
        commanded: &mut CommandedRecord,
    ) {
        if std::mem::take(&mut self.on) {
            self.frames
                .iter_mut()
                .for_each(|frame| frame.started = false);
        }
        let Some(placements) = &mut self.placements else {
            return;
        };
        let shown = client.is_some_and(|r| r.frames.iter().any(|frame| frame.used == 1));
        if shown {
            placements.set(&measured.joints);
        }
        for (i, (frame, shown_of)) in self.frames.iter().zip(&mut commanded.frames).enumerate() {
            let used = client.and_then(|r| r.frames.get(i));
            *shown_of = if used.is_some_and(|used| used.used == 1) {
                frame.pose_record(placements)
            } else {
                FrameCommanded::default()
            };
        }
    }

    /// Adds the torques of the frames to those of inverse dynamics, of which `carried` is taken off.
    pub(super) fn lead(
        &mut self,
        asked: &Asked<'_>,
        (seen, carried): (&Seen<'_>, &[Wrench]),
        torques: &mut [RigidBodyTorque],
        commanded: &mut CommandedRecord,
    ) {
        let Some(placements) = &mut self.placements else {
            return;
        };
        self.on = true;
        self.led.fill(false);
        for (j, dq) in self.dq.iter_mut().enumerate() {
            *dq = seen.velocity(j);
        }
        placements.set_angles(&seen.measured.joints);
        let (model, data) = (&placements.model, &mut placements.data);
        crba(model, data, &placements.q);
        forward_kinematics(model, data, &placements.q);
        let age_s = asked.age_s;
        let all = self.frames.iter_mut().zip(&asked.reference.frames);
        for ((frame, asked), shown) in all.zip(&mut commanded.frames) {
            if asked.used != 1 {
                *shown = FrameCommanded::default();
                continue;
            }
            for &j in &frame.parameters.joints {
                if let Some(led) = self.led.get_mut(j) {
                    *led = true;
                }
            }
            let aligned = ReferenceFrame::LocalWorldAligned;
            frame_jacobian(
                &placements.model,
                &placements.data,
                frame.parameters.link,
                aligned,
                &mut self.jacobian,
            );
            let base = placements.model.base_size();
            let columns = |j: usize| {
                let place = placements.place.get(j)?;
                let column = place - base.1 + base.0;
                (column < self.jacobian.ncols()).then(|| self.jacobian.column(column).into_owned())
            };
            frame.take(placements, columns, &self.dq);
            *shown = frame.lead(
                &target(asked, age_s),
                placements,
                (seen, carried),
                self.sample_period,
                torques,
            );
        }
    }
}

/// Reference of a client for a frame, at the instant of this cycle.
fn target(asked: &FrameReference, age_s: f64) -> CartesianTarget {
    let pose = pose(asked);
    let axes = match asked.own_axes {
        1 => pose.rotation,
        _ => Matrix3::identity(),
    };
    let velocity = Vector6::from(asked.velocity);
    let turned = |k: usize| axes * velocity.fixed_rows::<3>(k).into_owned() * age_s;
    let turn = UnitQuaternion::from_scaled_axis(turned(3)).to_rotation_matrix();
    CartesianTarget {
        pose: Se3::new(
            turn.into_inner() * pose.rotation,
            pose.translation + turned(0),
        ),
        velocity,
        stiffness: Vector6::from(asked.stiffness),
        force: Vector6::from(asked.force),
        damping_ratio: asked.damping_ratio,
        feedback: std::array::from_fn(|i| asked.force_axes >> i & 1 == 1),
        axes,
    }
}

/// Inertia that the joint's torque law adds to the link's.
fn effective_inertia(joint: &JointParameters, parameters: &Parameters) -> f64 {
    match (parameters.torque_law, joint.has_link_encoder) {
        (TorqueLaw::Predictive(_), true) => joint.law.effective_inertia(),
        _ => 0.0,
    }
}

impl Frame {
    fn new(parameters: &FrameParameters, robot: &Robot) -> Self {
        let p = &robot.parameters;
        let n = parameters.joints.len();
        let frame = |ft: &FtParameters| robot.model.frame_index(&ft.sensor.frame);
        let joints = || parameters.joints.iter().map(|&j| &p.joints[j]);
        let gains: Vec<[f64; 2]> = joints().map(|j| [j.gains.k_s, j.gains.k_d]).collect();
        let posture = [parameters.posture_stiffness, parameters.posture_damping];
        let bounds: Vec<[f64; 2]> = (gains.iter())
            .map(|own| std::array::from_fn(|k| (1.0 - posture[k]) * own[k]))
            .collect();
        let slow = joints().map(|joint| parameters.approach * joint.limits.velocity);
        Self {
            law: CartesianLaw::new(parameters.limits),
            sensor: parameters
                .sensor
                .and_then(|s| Some((s, frame(p.ft_sensors.get(s)?)?))),
            external_delay: p.external_torque.as_ref().map(|e| 1.0 / e.gain),
            columns: vec![Vector6::zeros(); n],
            dq: vec![0.0; n],
            approach: Approaches::new(bounds, slow),
            effective_inertia: joints().map(|j| effective_inertia(j, p)).collect(),
            posture: (gains.iter())
                .map(|own| Impedance {
                    stiffness: posture[0] * own[0],
                    damping: posture[1] * own[1],
                })
                .collect(),
            factor: vec![0.0; n * n],
            solved: vec![Vector6::zeros(); n],
            started: false,
            parameters: parameters.clone(),
        }
    }

    /// How a joint keeps its posture, if this frame leads it.
    fn posture(&self, joint: usize) -> Option<Impedance> {
        let place = self.parameters.joints.iter().position(|&j| j == joint)?;
        self.posture.get(place).copied().filter(|_| self.started)
    }

    /// Jacobian and velocities of this cycle, in the base's axes.
    fn take(
        &mut self,
        placements: &Placements,
        columns: impl Fn(usize) -> Option<Vector6<f64>>,
        dq: &[f64],
    ) {
        let base = frame_placement(&placements.model, &placements.data, self.parameters.base);
        let to_base = base.rotation.transpose();
        let own = self.columns.iter_mut().zip(&mut self.dq);
        for ((column, rate), &j) in own.zip(&self.parameters.joints) {
            let wide = columns(j).unwrap_or_default();
            for k in [0, 3] {
                let part = to_base * wide.fixed_rows::<3>(k);
                column.fixed_rows_mut::<3>(k).copy_from(&part);
            }
            *rate = dq.get(j).copied().unwrap_or(0.0);
        }
    }

    /// `J M^-1 J^T` of the limb, its base and all other joints held; zero where `M` is no mass matrix.
    fn mobility(&mut self, placements: &Placements) -> Matrix6<f64> {
        let mass = placements.data.mass_matrix();
        let base = placements.model.base_size();
        let n = self.columns.len();
        let place = |i: usize| {
            let joint = self.parameters.joints.get(i)?;
            Some(placements.place.get(*joint)? - base.1 + base.0)
        };
        for i in 0..n {
            for k in 0..=i {
                let entry = place(i).zip(place(k)).and_then(|at| mass.get(at));
                let (own, other) = (i * n, k * n);
                let f = &self.factor;
                let known: f64 = (0..k).map(|m| f[own + m] * f[other + m]).sum();
                let felt = if k == i {
                    self.effective_inertia[i]
                } else {
                    0.0
                };
                let rest = entry.copied().unwrap_or(0.0) + felt - known;
                self.factor[own + k] = if k < i {
                    rest / f[other + k]
                } else {
                    rest.sqrt()
                };
            }
        }
        // Y = L^-1 J^T, a row for each joint.
        let mut mobility = Matrix6::zeros();
        for i in 0..n {
            let factors = &self.factor[i * n..i * n + n];
            let mut row = self.columns[i];
            for (factor, other) in factors.iter().zip(&self.solved).take(i) {
                row -= other * *factor;
            }
            row /= factors[i];
            mobility += row * row.transpose();
            self.solved[i] = row;
        }
        if mobility.iter().all(|x| x.is_finite()) {
            mobility
        } else {
            Matrix6::zeros()
        }
    }

    /// Wrench at the frame of the F/T sensor, as a wrench at this frame, in the base's axes.
    fn at_frame(&self, placements: &Placements, at: usize, wrench: &Wrench) -> Vector6<f64> {
        let p = &self.parameters;
        let local = Force::new(wrench.force.into(), wrench.torque.into());
        let at_frame = placements.between(p.link, at).act_force(local);
        let rotation = placements.between(p.base, p.link).rotation;
        let (f, n) = (rotation * at_frame.linear, rotation * at_frame.angular);
        Vector6::new(f.x, f.y, f.z, n.x, n.y, n.z)
    }

    /// Wrench of the environment on the frame, in the base's axes: what `carried` takes off the joints already; as late
    /// as the filters know it; as it is felt, with that delay, s.
    fn forces(
        &self,
        placements: &Placements,
        (seen, carried): (&Seen<'_>, &[Wrench]),
    ) -> (Vector6<f64>, Vector6<f64>, Felt) {
        let Some((sensor, at)) = self.sensor else {
            let delay = self.external_delay;
            let force = delay.and_then(|_| self.external_force(seen.estimated));
            let late = delay.unwrap_or(0.0) + seen.measured.filter_delay_s;
            return (Vector6::zeros(), Vector6::zeros(), Felt { force, late });
        };
        let (Some(estimated), Some(measured)) =
            (seen.estimated.ft.get(sensor), seen.measured.ft.get(sensor))
        else {
            return (Vector6::zeros(), Vector6::zeros(), Felt::default());
        };
        let contact = &estimated.contact_wrench;
        let known = self.at_frame(placements, at, contact);
        let taken_off = carried.get(sensor);
        let taken_off =
            taken_off.map_or(Vector6::zeros(), |own| self.at_frame(placements, at, own));
        // Change that the filters do not show yet: the weight beyond the sensor hardly changes meanwhile.
        let [long, now, before] =
            [contact, &measured.wrench, &measured.wrench_hat].map(Wrench::to_array);
        let fast = Wrench::from_array(std::array::from_fn(|i| long[i] + now[i] - before[i]));
        let force = Some(self.at_frame(placements, at, &fast));
        (taken_off, known, Felt { force, late: 0.0 })
    }

    /// Wrench of the environment on the frame by external torques: least squares, in which directions without lever
    /// count as free of force.
    fn external_force(&self, estimated: &EstimatedRecord) -> Option<Vector6<f64>> {
        // A torque at the frame counts as a force at a lever of a metre.
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for (column, &j) in self.columns.iter().zip(&self.parameters.joints) {
            normal += column * column.transpose();
            right += column * estimated.joints.get(j)?.tau_ext;
        }
        let least = LEAST_LEVER * LEAST_LEVER * normal.trace();
        let normal = normal + Matrix6::identity() * least.max(f64::MIN_POSITIVE);
        let force = normal.cholesky()?.solve(&right);
        force.iter().all(|x| x.is_finite()).then_some(force)
    }

    fn lead(
        &mut self,
        target: &CartesianTarget,
        placements: &Placements,
        (seen, carried): (&Seen<'_>, &[Wrench]),
        dt: f64,
        torques: &mut [RigidBodyTorque],
    ) -> FrameCommanded {
        let p = &self.parameters;
        let pose = placements.between(p.base, p.link);
        let (taken_off, known, felt) = self.forces(placements, (seen, carried));
        if !std::mem::replace(&mut self.started, true) {
            let bears = self.sensor.map_or(felt.force, |_| Some(known));
            self.law.start(&pose, bears, target);
            self.approach.restart();
        }
        let mobility = self.mobility(placements);
        let limb = Limb {
            pose,
            jacobian: &self.columns,
            mobility,
            dq: &self.dq,
            bounds: self.approach.left(),
            force: felt.force,
            late: felt.late,
        };
        let wrench = self.law.wrench(target, &limb, dt);
        let asked = wrench.feedforward + wrench.force;
        let short = asked + felt.force.unwrap_or_default();
        let joints = self.approach.joints().zip(&self.dq);
        for ((column, &j), (approach, &dq)) in
            (self.columns.iter().zip(&self.parameters.joints)).zip(joints)
        {
            let Some(torque) = torques.get_mut(j) else {
                continue;
            };
            //= D 5.4: tau_d = h_hat + J^T (K (x_d - x) + D (v_d - v) - f*)
            torque.feedforward += column.dot(&(wrench.feedforward + taken_off));
            torque.force_feedback += column.dot(&wrench.force);
            torque.frame_position += column.dot(&wrench.position);
            torque.frame_velocity += column.dot(&wrench.velocity) + approach.torque(dq);
            approach.follow(column.dot(&asked), column.dot(&short));
        }
        self.record(&pose, &wrench, felt.force)
    }
}
