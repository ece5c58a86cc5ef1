//! External torque of every joint by generalised momentum, without accelerations of joints
//! (L: A. De Luca, R. Mattone: Sensorless robot collision detection and hybrid
//! force/motion control, ICRA 2005).
//!
//! With the base's motion known (IMU), the joints obey `M ddq + h = tau + tau_ext`, where `M` is
//! the joints' block of the mass matrix and `h` holds velocities, gravity and the base's motion.
//! The observer integrates `d(M dq)/dt = tau + tau_ext - h + dM/dt dq` and lets the error of the
//! momentum be the external torque: `r = K (M dq - integral)`, a first-order lag of `tau_ext`.

use dynamics::{Base, Data, Force, Model, Motion, crba, rnea};
use nalgebra::Vector3;
use simd::{Instructions, Kernel, Lanes, Pack, WIDTH};

/// Parameters of a [`MomentumObserver`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MomentumObserverParameters {
    /// T: time between updates, s.
    pub sample_period: f64,
    /// K: bandwidth, 1/s; its inverse is the delay of `tau_ext`.
    pub gain: f64,
}

/// Observer of one robot. Joints are in the model's order.
#[derive(Debug, Clone)]
pub struct MomentumObserver {
    model: Model,
    data: Data,
    parameters: MomentumObserverParameters,
    tau_ext: Vec<f64>,
    /// p_hat and M dq.
    integral: Vec<f64>,
    momentum: Vec<f64>,
    /// M of the last update: of each four rows all columns.
    last_mass: Vec<Pack>,
    last_dq: Vec<f64>,
    /// Mean of dq and the last one.
    mean_dq: Vec<f64>,
    instructions: Instructions,
    last_rate: Vec<f64>,
    state: [Vec<f64>; 3],
    started: bool,
}

impl MomentumObserver {
    /// A floating base moves as given to `update`; a fixed one stands still.
    #[must_use]
    pub fn new(model: &Model, parameters: MomentumObserverParameters) -> Self {
        let mut model = model.clone();
        let n = model.joint_count();
        let mut q = vec![0.0; model.nq()];
        if model.base() == Base::Floating {
            // The base's proper acceleration holds gravity already.
            model.set_gravity(Vector3::zeros());
            q[6] = 1.0;
        }
        let nv = model.nv();
        Self {
            data: Data::new(&model),
            tau_ext: vec![0.0; n],
            integral: vec![0.0; n],
            last_mass: vec![Pack::ZERO; n.div_ceil(WIDTH) * n],
            mean_dq: vec![0.0; n],
            instructions: Instructions::detect(),
            momentum: vec![0.0; n],
            last_dq: vec![0.0; n],
            last_rate: vec![0.0; n],
            state: [q, vec![0.0; nv], vec![0.0; nv]],
            started: false,
            parameters,
            model,
        }
    }

    /// The last result.
    #[must_use]
    pub fn tau_ext(&self) -> &[f64] {
        &self.tau_ext
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.started = false;
        self.tau_ext.fill(0.0);
    }

    /// tau_ext, N·m, of every joint, from angles, velocities, torques, and the root's twist and
    /// proper acceleration ([`crate::WholeBody::base_motion`]) at one instant; the latter two are not
    /// used with a fixed base. `known`: wrenches on each body that are known (declared contacts) and
    /// so not part of `tau_ext`. Values that are not finite leave the last result.
    pub fn update(
        &mut self,
        q: &[f64],
        dq: &[f64],
        tau: &[f64],
        base: (Motion, Motion),
        known: Option<&[Force]>,
    ) -> &[f64] {
        let n = self.tau_ext.len();
        let finite = |x: &[f64]| x.len() >= n && x.iter().all(|x| x.is_finite());
        let motions = [base.0.to_array(), base.1.to_array()];
        if !(finite(q)
            && finite(dq)
            && finite(tau)
            && motions.iter().flatten().all(|x| x.is_finite()))
        {
            return &self.tau_ext;
        }
        let (bv, bq) = self.model.base_size();
        let [full_q, v, a] = &mut self.state;
        full_q[bq..].copy_from_slice(&q[..n]);
        v[bv..].copy_from_slice(&dq[..n]);
        if bv == 6 {
            v[..6].copy_from_slice(&motions[0]);
            a[..6].copy_from_slice(&motions[1]);
        }
        let mass = crba(&self.model, &mut self.data, full_q).as_slice();
        let rates = dq.iter().zip(&mut self.last_dq);
        for ((dq, last), mean) in rates.zip(&mut self.mean_dq) {
            *mean = if self.started {
                0.5 * (dq + *last)
            } else {
                0.0
            };
            *last = *dq;
        }
        let momenta = Momenta {
            mass,
            base: bv,
            last_mass: &mut self.last_mass,
            dq: &dq[..n],
            mean_dq: &self.mean_dq,
            momentum: &mut self.momentum,
            integral: &mut self.integral,
        };
        simd::run(self.instructions, momenta);
        //= L: h = C dq + g, with the base's motion, less the known contacts
        let h = &rnea(&self.model, &mut self.data, full_q, v, a, known)[bv..];
        let dt = self.parameters.sample_period;
        for j in 0..n {
            let rate = tau[j] - h[j];
            // Trapezoids: between two samples the rate is the mean of both.
            let mean = 0.5 * (rate + self.last_rate[j]);
            //= L: p_hat = int (tau + C^T dq - g + r) dt, C^T dq = dM/dt dq - C dq
            self.integral[j] += (mean + self.tau_ext[j]) * dt;
            self.last_rate[j] = rate;
        }
        if !self.started {
            self.integral.copy_from_slice(&self.momentum);
            self.started = true;
            return &self.tau_ext;
        }
        let errors = self.momentum.iter().zip(&self.integral);
        for (r, (p, i)) in self.tau_ext.iter_mut().zip(errors) {
            //= L: r = K (M dq - p_hat)
            *r = self.parameters.gain * (p - i);
        }
        &self.tau_ext
    }
}

/// `M dq`, and the integral's share of the change of M since the last update.
struct Momenta<'a> {
    /// M by columns, with the base's rows and columns first.
    mass: &'a [f64],
    base: usize,
    last_mass: &'a mut [Pack],
    dq: &'a [f64],
    mean_dq: &'a [f64],
    momentum: &'a mut [f64],
    integral: &'a mut [f64],
}

impl Kernel for Momenta<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let n = self.dq.len().max(1);
        let rows = (self.momentum.chunks_mut(WIDTH)).zip(self.integral.chunks_mut(WIDTH));
        let last_mass = self.last_mass.chunks_exact_mut(n);
        for (four, ((momentum, integral), last_mass)) in rows.zip(last_mass).enumerate() {
            let columns = self.mass.chunks_exact(self.base + n).skip(self.base);
            let rates = self.dq.iter().zip(self.mean_dq);
            let (mut sum, mut change) = (L::splat(0.0), L::load_part(integral));
            for ((column, last), (dq, mean)) in columns.zip(last_mass).zip(rates) {
                let own = column.get(self.base + WIDTH * four..).unwrap_or(&[]);
                let mass = L::load_part(own);
                sum = mass.mul_add(L::splat(*dq), sum);
                // dM/dt dq dt
                change = (mass - L::load(last)).mul_add(L::splat(*mean), change);
                mass.store(last);
            }
            sum.store_part(momentum);
            change.store_part(integral);
        }
    }
}
