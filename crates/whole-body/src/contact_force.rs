//! Force at one frame that explains the joints' external torques.

use dynamics::{Base, Data, Model, ReferenceFrame, forward_kinematics, frame_jacobian};
use nalgebra::{Matrix3, Matrix6xX, Vector3};

/// Greatest standard deviation of a force that counts as known, over that of its best direction: a
/// stretched limb does not feel a force along itself.
const WORST_CONDITION: f64 = 30.0;

/// Least-squares contact force at a frame, by weights of the torques' variances.
#[derive(Debug, Clone)]
pub struct ContactForce {
    model: Model,
    data: Data,
    frame: usize,
    q: Vec<f64>,
    jacobian: Matrix6xX<f64>,
}

impl ContactForce {
    /// At a frame of the model, by its index.
    #[must_use]
    pub fn new(model: &Model, frame: usize) -> Self {
        let mut q = vec![0.0; model.nq()];
        if model.base() == Base::Floating {
            q[6] = 1.0;
        }
        Self {
            data: Data::new(model),
            frame,
            q,
            jacobian: Matrix6xX::zeros(model.nv()),
            model: model.clone(),
        }
    }

    /// The force, N, in the root's axes, and its standard deviation, from angles, external torques and
    /// their standard deviations (model order). None where it does not follow from the torques.
    pub fn update(
        &mut self,
        q: &[f64],
        tau_ext: &[f64],
        sigma: &[f64],
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (bv, bq) = self.model.base_size();
        for (own, q) in self.q.iter_mut().skip(bq).zip(q) {
            *own = *q;
        }
        forward_kinematics(&self.model, &mut self.data, &self.q);
        let aligned = ReferenceFrame::LocalWorldAligned;
        frame_jacobian(
            &self.model,
            &self.data,
            self.frame,
            aligned,
            &mut self.jacobian,
        );
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for ((column, tau), sigma) in self.jacobian.column_iter().skip(bv).zip(tau_ext).zip(sigma) {
            let row: Vector3<f64> = column.fixed_rows::<3>(0).into();
            let weight = (sigma * sigma).max(f64::MIN_POSITIVE).recip();
            normal += weight * row * row.transpose();
            right += weight * *tau * row;
        }
        if !normal.iter().chain(&right).all(|x| x.is_finite()) {
            return None;
        }
        let values = normal.symmetric_eigenvalues();
        let (least, most) = (values.min(), values.max());
        if least.is_nan() || most <= 0.0 || least * WORST_CONDITION.powi(2) < most {
            return None;
        }
        // J^T f = tau_ext, by weighted least squares.
        let covariance = normal.try_inverse()?;
        let sigma = covariance.diagonal().map(|v| v.max(0.0).sqrt());
        Some((covariance * right, sigma))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynamics::Random;

    const ARM: &str = r#"<robot name="arm">
      <link name="base"/>
      <link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="c"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="d"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
      <joint name="2" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
      <joint name="3" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/></joint>
      <joint name="4" type="continuous"><parent link="c"/><child link="d"/><origin xyz="0.3 0 0"/><axis xyz="1 0 0"/></joint>
    </robot>"#;

    /// Torques that a force makes give that force again; with noise it scatters as its standard
    /// deviation states; a stretched arm does not know the force along itself.
    #[test]
    fn a_force_is_found_from_its_torques() {
        let model = Model::from_urdf(ARM, "arm.urdf", Base::Fixed).unwrap();
        let frame = model.frame_index("d").unwrap();
        let mut at_frame = ContactForce::new(&model, frame);
        let mut random = Random::new(3);
        let sigma = [0.3, 0.2, 0.2, 0.1];
        let q = [0.3, -0.5, 1.2, 0.4];
        let force = Vector3::new(12.0, -30.0, 8.0);
        let mut data = Data::new(&model);
        forward_kinematics(&model, &mut data, &q);
        let mut j = Matrix6xX::zeros(4);
        frame_jacobian(
            &model,
            &data,
            frame,
            ReferenceFrame::LocalWorldAligned,
            &mut j,
        );
        let tau = j.rows(0, 3).transpose() * force;
        let (found, _) = at_frame.update(&q, tau.as_slice(), &sigma).unwrap();
        assert!((found - force).norm() < 1e-9, "{found}");
        let (mut squares, n) = (Vector3::zeros(), 4000);
        let mut expected = Vector3::zeros();
        for _ in 0..n {
            let noise = random.vector(4, 3f64.sqrt());
            let noisy: Vec<f64> = (0..4).map(|i| tau[i] + sigma[i] * noise[i]).collect();
            let (found, sigma) = at_frame.update(&q, &noisy, &sigma).unwrap();
            squares += (found - force).component_mul(&(found - force)) / f64::from(n);
            expected = sigma;
        }
        for i in 0..3 {
            let ratio = squares[i].sqrt() / expected[i];
            assert!((0.95..1.05).contains(&ratio), "axis {i}: {ratio}");
        }
        assert_eq!(
            at_frame.update(&[0.3, 0.2, 0.0, 0.0], tau.as_slice(), &sigma),
            None
        );
        assert_eq!(at_frame.update(&q, &[f64::NAN; 4], &sigma), None);
    }
}
