//! The contact wrenches under one hypothesis, and their share in the joint torques.

use crate::contacts::{Contact, ContactSet};
use crate::layout::Layout;
use crate::least_squares::{Six, dot, pseudo_inverse, whitening};
use crate::mechanics::Mechanics;
use crate::parameters::Residual;
use dynamics::{Force, Model, Motion, Se3};
use nalgebra::{Matrix6, Vector3};

/// One hypothesis, solved.
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    /// Per contact: its unknowns' values, as a wrench at its frame, and in the root's.
    pub(crate) local: Vec<Force>,
    pub(crate) wrench: Vec<Force>,
    /// Per part: `b - A x` in the root's frame.
    pub(crate) residual: Vec<Force>,
    /// Per part: columns of `A`, about the part's origin.
    pub(crate) columns: Vec<[Six; 6]>,
    /// Per part: rows of the (weighted) pseudo-inverse, about the part's origin.
    pub(crate) rows: Vec<[Six; 6]>,
    /// Per part: independent unknowns.
    pub(crate) rank: Vec<usize>,
}

impl Solution {
    pub(crate) fn new(set: &ContactSet) -> Self {
        let (contacts, parts) = (set.contacts.len(), set.parts.len());
        Self {
            local: vec![Force::zero(); contacts],
            wrench: vec![Force::zero(); contacts],
            residual: vec![Force::zero(); parts],
            columns: vec![[[0.0; 6]; 6]; parts],
            rows: vec![[[0.0; 6]; 6]; parts],
            rank: vec![0; parts],
        }
    }

    /// Whether every unknown has been found.
    pub(crate) fn determined(&self, set: &ContactSet) -> bool {
        self.rank.iter().zip(&set.parts).all(|(r, (_, n))| r == n)
    }

    /// `covariance`: of each part's `b` about the part's origin, where weights follow it.
    pub(crate) fn solve(
        &mut self,
        model: &Model,
        layout: &Layout,
        mechanics: &Mechanics,
        set: &ContactSet,
        covariance: Option<&[[Six; 6]]>,
    ) {
        for (part, (range, unknowns)) in set.parts.iter().enumerate() {
            let net = mechanics.net[part];
            if let Some(contact) = set.single_full(part) {
                //= D 2.4: sum_i f_i + f_u = I dv_l + dI v_l
                let frame = mechanics.in_root[contact.body].compose(&contact.placement);
                self.local[range.start] = frame.inverse_act_force(net);
                self.wrench[range.start] = net;
                self.residual[part] = Force::zero();
                self.rank[part] = 6;
                continue;
            }
            self.residual[part] = net;
            self.rank[part] = 0;
            if *unknowns == 0 {
                continue;
            }
            let origin = mechanics.origin(model, layout, part);
            self.columns[part] = set.columns(mechanics, part, &origin);
            //= D 2.4: x = A^+ b (weighted by the covariance of b where asked)
            let (columns, rows) = (&self.columns[part], &mut self.rows[part]);
            self.rank[part] = weighted_inverse(columns, *unknowns, covariance, part, rows);
            let b = about(net, &origin).to_array();
            let mut first = 0;
            for (c, contact) in set.contacts[range.clone()].iter().enumerate() {
                let n = contact.kind.unknowns();
                let mut x = [0.0; 6];
                for (x, row) in x.iter_mut().zip(&self.rows[part][first..first + n]) {
                    *x = dot(row, &b);
                }
                first += n;
                let frame = mechanics.in_root[contact.body].compose(&contact.placement);
                let local = contact.wrench(&x[..n]);
                let wrench = frame.act_force(local);
                self.local[range.start + c] = local;
                self.wrench[range.start + c] = wrench;
                self.residual[part] -= wrench;
            }
        }
    }

    /// Adds the contacts' share of the joint torques, times `weight`.
    pub(crate) fn add_torques(
        &self,
        layout: &Layout,
        mechanics: &Mechanics,
        set: &ContactSet,
        residual: Residual,
        weight: f64,
        tau: &mut [f64],
    ) {
        for (contact, wrench) in set.contacts.iter().zip(&self.wrench) {
            for &b in &contact.path {
                tau[b] -= weight * mechanics.axis[b].dot(*wrench);
            }
        }
        if residual == Residual::Stays {
            return;
        }
        for s in 0..layout.sensors.len() {
            let handed_on = self.residual[s + 1];
            let mut sensor = &layout.sensors[s];
            loop {
                for &b in &sensor.carriers {
                    tau[b] += weight * mechanics.axis[b].dot(handed_on);
                }
                match sensor.before.checked_sub(1) {
                    Some(next) => sensor = &layout.sensors[next],
                    None => break,
                }
            }
        }
    }

    /// Response of the torque about `axis` (about a part's origin) to each component of the part's
    /// `b`, through the contacts that count.
    fn response(
        &self,
        set: &ContactSet,
        part: usize,
        axis: Motion,
        counts: impl Fn(&Contact) -> bool,
    ) -> Motion {
        if set.single_full(part).is_some() {
            return axis;
        }
        let columns = &self.columns[part];
        let mut y = [0.0; 6];
        let mut k = 0;
        for contact in &set.contacts[set.parts[part].0.clone()] {
            for _ in 0..contact.kind.unknowns() {
                if counts(contact) {
                    let effect = axis.dot(Force::from_array(columns[k]));
                    for (y, row) in y.iter_mut().zip(&self.rows[part][k]) {
                        *y += effect * row;
                    }
                }
                k += 1;
            }
        }
        Motion::from_array(y)
    }
}

/// All hypotheses, solved, and their shares in the torques.
#[derive(Clone, Copy)]
pub(crate) struct Hypotheses<'a> {
    pub(crate) sets: &'a [ContactSet],
    pub(crate) solutions: &'a [Solution],
    pub(crate) weights: &'a [f64],
}

impl<'a> Hypotheses<'a> {
    fn shares(self) -> impl Iterator<Item = (&'a ContactSet, &'a Solution, f64)> {
        let all = self.sets.iter().zip(self.solutions).zip(self.weights);
        all.map(|((set, solution), weight)| (set, solution, *weight))
            .filter(|(_, _, weight)| *weight != 0.0)
    }

    /// Response of a body's joint torque to its part's `b` about the part's origin, through the
    /// contacts that the joint carries. None if it carries none.
    pub(crate) fn contacts_response(
        self,
        part: usize,
        body: usize,
        axis: Motion,
        origin: &Vector3<f64>,
    ) -> Option<Motion> {
        let carries = |c: &Contact| c.path.contains(&body);
        let axis = motion_about(axis, origin);
        let mut z = None;
        for (set, solution, weight) in self.shares() {
            if set.contacts[set.parts[part].0.clone()].iter().any(carries) {
                let y = solution.response(set, part, axis, carries);
                z = Some(z.unwrap_or(Motion::zero()) - y * weight);
            }
        }
        z
    }

    /// Response of the torque about `axis` of a joint that takes the residual of a part beyond it
    /// to that part's `b` about its origin. None if there is no residual.
    pub(crate) fn residual_response(
        self,
        part: usize,
        axis: Motion,
        origin: &Vector3<f64>,
    ) -> Option<Motion> {
        let axis = motion_about(axis, origin);
        let mut z = None;
        for (set, solution, weight) in self.shares() {
            if set.single_full(part).is_none() {
                // The residual is b - A A^+ b.
                let y = solution.response(set, part, axis, |_| true);
                z = Some(z.unwrap_or(Motion::zero()) + (axis - y) * weight);
            }
        }
        z
    }
}

/// A motion of the root's frame about another point.
fn motion_about(m: Motion, origin: &Vector3<f64>) -> Motion {
    Motion::new(m.linear - origin.cross(&m.angular), m.angular)
}

/// A wrench of the root's frame about another point.
pub(crate) fn about(f: Force, origin: &Vector3<f64>) -> Force {
    Force::new(f.linear, f.angular - origin.cross(&f.linear))
}

/// The pseudo-inverse, weighted by the covariance's inverse if there is one. Rank 0 where that
/// covariance is singular.
fn weighted_inverse(
    columns: &[Six; 6],
    n: usize,
    covariance: Option<&[[Six; 6]]>,
    part: usize,
    rows: &mut [Six; 6],
) -> usize {
    let mut w = [[0.0; 6]; 6];
    // With as many unknowns as equations weights change nothing.
    let Some(covariance) = covariance.and_then(|c| c.get(part)).filter(|_| n < 6) else {
        return pseudo_inverse(columns, n, rows);
    };
    if !whitening(covariance, &mut w) {
        return 0;
    }
    let white = columns.map(|column| w.map(|row| dot(&row, &column)));
    let mut of_white = [[0.0; 6]; 6];
    let rank = pseudo_inverse(&white, n, &mut of_white);
    for (row, white) in rows.iter_mut().zip(&of_white).take(n) {
        *row = std::array::from_fn(|c| (0..6).map(|k| white[k] * w[k][c]).sum());
    }
    rank
}

/// Unit wrenches of a frame, about `origin`, as columns.
pub(crate) fn unit_wrenches(frame: &Se3, origin: &Vector3<f64>) -> Matrix6<f64> {
    let mut columns = Matrix6::zeros();
    for k in 0..6 {
        let mut unit = [0.0; 6];
        unit[k] = 1.0;
        let f = frame.act_force(Force::from_array(unit));
        let about = Force::new(f.linear, f.angular - origin.cross(&f.linear));
        columns.set_column(k, &about.to_vector());
    }
    columns
}
