//! No algorithm allocates once `Data` is made.

use dynamics::*;
use nalgebra::{DMatrix, Matrix3xX, Matrix6xX};
use test_support::allocations;

mod support;

#[test]
fn nothing_allocates() {
    let kinds = [
        (1, false, Base::Floating),
        (2, true, Base::Floating),
        (3, false, Base::Fixed),
        // A chain, too few limbs for the lanes.
        (4, false, Base::Fixed),
    ];
    for (seed, mimic, base) in kinds {
        let kind = support::Kind {
            links: if seed == 4 { 10 } else { 30 },
            base,
            mimic,
            chain: seed == 4,
            aligned: false,
        };
        let model = support::random_model(seed, kind);
        let [mut q, v, a] = support::random_state(seed, &model);
        let bv = model.nv() - model.joint_count();
        let mut x = v.clone();
        let f = vec![Force::zero(); model.bodies().len()];
        let mut data = Data::new(&model);
        let mut j6 = Matrix6xX::zeros(model.nv());
        let mut j3 = Matrix3xX::zeros(model.nv());
        let mut y = DMatrix::zeros(
            model.nv(),
            PARAMETERS * (model.bodies().len() - usize::from(bv == 0)),
        );
        let frame = model.frames().len() - 1;
        let (m, d) = (&model, &mut data);
        let before = allocations();
        for instructions in [Instructions::Portable, Instructions::detect()] {
            d.set_instructions(instructions);
            rnea(m, d, &q, &v, &a, Some(&f));
            nle(m, d, &q, &v);
            gravity(m, d, &q);
            crba(m, d, &q);
            cholesky_decompose(m, d);
            cholesky_solve(m, d, &mut x);
            aba(m, d, &q, &v, &a, Some(&f));
        }
        forward_kinematics(m, d, &q);
        forward_kinematics_velocity(m, d, &q, &v);
        forward_kinematics_acceleration(m, d, &q, &v, &a);
        frame_placement(m, d, frame);
        for reference in [
            ReferenceFrame::Local,
            ReferenceFrame::World,
            ReferenceFrame::LocalWorldAligned,
        ] {
            frame_jacobian(m, d, frame, reference, &mut j6);
            frame_jacobian_rate_times_velocity(m, d, frame, reference);
            frame_velocity(m, d, frame, reference);
            frame_acceleration(m, d, frame, reference);
            frame_classical_acceleration(m, d, frame, reference);
        }
        center_of_mass(m, d);
        center_of_mass_jacobian(m, d, &mut j3);
        centroidal_map(m, d, &mut j6);
        centroidal_momentum(m, d);
        kinetic_energy(m, d, &v);
        potential_energy(m, d);
        joint_torque_regressor(m, d, &q, &v, &a, &mut y);
        integrate(m, &mut q, &v, 1e-3);
        let after = allocations();
        assert_eq!(after - before, 0, "allocations");
        drop(Data::new(m));
        assert!(allocations() > after, "the counter counts");
        assert!(x.iter().all(|x| x.is_finite()));
    }
}
