//! The contact wrenches under one hypothesis, and their share in the joint torques.

use crate::contacts::ContactSet;
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

    /// `y`: response of a joint's torque to each component of its part's `b` about the part's
    /// origin, through the contacts that the joint carries. None if it carries none.
    pub(crate) fn share(
        &self,
        mechanics: &Mechanics,
        set: &ContactSet,
        part: usize,
        body: usize,
        origin: &Vector3<f64>,
    ) -> Option<Motion> {
        let (range, unknowns) = &set.parts[part];
        let contacts = &set.contacts[range.clone()];
        if !contacts.iter().any(|c| c.path.contains(&body)) {
            return None;
        }
        let axis =
            Se3::new(Se3::identity().rotation, *origin).inverse_act_motion(mechanics.axis[body]);
        if *unknowns == 6 && contacts.len() == 1 {
            return Some(axis);
        }
        let columns = &self.columns[part];
        let mut y = [0.0; 6];
        let mut k = 0;
        for contact in contacts {
            for _ in 0..contact.kind.unknowns() {
                if contact.path.contains(&body) {
                    let effect = axis.dot(Force::from_array(columns[k]));
                    for (y, row) in y.iter_mut().zip(&self.rows[part][k]) {
                        *y += effect * row;
                    }
                }
                k += 1;
            }
        }
        Some(Motion::from_array(y))
    }
}

/// A wrench of the root's frame about another point.
pub(crate) fn about(f: Force, origin: &Vector3<f64>) -> Force {
    Force::new(f.linear, f.angular - origin.cross(&f.linear))
}

/// The pseudo-inverse, weighted by the covariance's inverse if there is one and it can be inverted.
fn weighted_inverse(
    columns: &[Six; 6],
    n: usize,
    covariance: Option<&[[Six; 6]]>,
    part: usize,
    rows: &mut [Six; 6],
) -> usize {
    let mut w = [[0.0; 6]; 6];
    let covariance = covariance.and_then(|c| c.get(part));
    // With as many unknowns as equations weights change nothing.
    if n == 6 || !covariance.is_some_and(|c| whitening(c, &mut w)) {
        return pseudo_inverse(columns, n, rows);
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
