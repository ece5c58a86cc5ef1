//! No algorithm allocates after its memory was made.

use dynamics::*;
use nalgebra::{DMatrix, Matrix3xX, Matrix6xX};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;
static COUNT: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands everything to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are the system's.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, p: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are the system's.
        unsafe { System.dealloc(p, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

mod support;

#[test]
fn nothing_allocates() {
    for (seed, mimic) in [(1, false), (2, true)] {
        let kind = support::Kind {
            links: 30,
            base: Base::Floating,
            mimic,
        };
        let model = support::random_model(seed, kind);
        let [q, v, a] = support::random_state(seed, &model);
        let mut x = v.clone();
        let f = vec![Force::zero(); model.bodies().len()];
        let mut data = Data::new(&model);
        let mut j6 = Matrix6xX::zeros(model.nv());
        let mut j3 = Matrix3xX::zeros(model.nv());
        let mut y = DMatrix::zeros(model.nv(), PARAMETERS * model.bodies().len());
        let frame = model.frames().len() - 1;
        let (m, d) = (&model, &mut data);
        let imu = ImuMotion {
            angular_velocity: m.gravity(),
            angular_acceleration: m.gravity(),
            proper_acceleration: m.gravity(),
        };
        let before = COUNT.load(Ordering::Relaxed);
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
        forward_kinematics_acceleration(m, d, &q, &v, &a);
        let base = base_motion_from_imu(m, d, frame, &imu, &q[7..], &v[6..], &a[6..]);
        propagate(m, d, &base, &q[7..], &v[6..], &a[6..]);
        joint_wrenches(m, d, Some(&f));
        for reference in [
            ReferenceFrame::Local,
            ReferenceFrame::World,
            ReferenceFrame::LocalWorldAligned,
        ] {
            frame_jacobian(m, d, frame, reference, &mut j6);
            frame_jacobian_rate_times_velocity(m, d, frame, reference);
            frame_velocity(m, d, frame, reference);
        }
        center_of_mass_jacobian(m, d, &mut j3);
        centroidal_map(m, d, &mut j6);
        centroidal_momentum(m, d);
        kinetic_energy(m, d, &v);
        potential_energy(m, d);
        joint_torque_regressor(m, d, &q, &v, &a, &mut y);
        let after = COUNT.load(Ordering::Relaxed);
        assert_eq!(after - before, 0, "allocations");
        assert!(x.iter().all(|x| x.is_finite()));
    }
}
