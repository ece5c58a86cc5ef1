//! Forward dynamics by the mass matrix.

use crate::crba::mass_matrix;
use crate::data::{Data, packs};
use crate::kinematics::at;
use crate::model::Model;
use crate::rnea::rnea;
use crate::spatial::Force;
use simd::{Kernel, Lanes, Pack, WIDTH, run};

/// Solves `M ddq = tau - nle + sum J^T f`: for mimic joints, which couple bodies that the recursion
/// takes as independent, and for the few bodies of a chain, which give the recursion nothing to
/// compute side by side.
pub(super) fn by_mass_matrix(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    f_ext: Option<&[Force]>,
) {
    let zeros = std::mem::take(&mut data.zeros);
    rnea(model, data, q, v, &zeros, f_ext);
    data.zeros = zeros;
    for (i, x) in data.ddq.iter_mut().take(model.nv()).enumerate() {
        *x = at(tau, i) - data.tau[i];
    }
    mass_matrix(model, data, q, true);
    let kernel = Solve {
        m: data.mass_matrix.as_slice(),
        columns: &mut data.columns,
        inverse: &mut data.inverse_pivots,
        x: &mut data.ddq[..model.nv()],
    };
    run(data.instructions, kernel);
}

/// Solves `M x = b` in place by `M = L^T D L` from the last row, without regard to zeros. The
/// columns of `D L`, from the top to the diagonal, stand in packs; below it they hold leftovers.
struct Solve<'a> {
    /// By columns.
    m: &'a [f64],
    columns: &'a mut [Pack],
    /// Of each element of `D`.
    inverse: &'a mut [f64],
    x: &'a mut [f64],
}

impl Kernel for Solve<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (n, x) = (self.x.len(), self.x);
        let stride = packs(n);
        let columns = self.columns;
        for (k, column) in self.m.chunks_exact(n.max(1)).enumerate() {
            let own = &mut columns[k * stride..(k + 1) * stride];
            for (pack, four) in own.iter_mut().zip(column.chunks(WIDTH)) {
                pack.0[..four.len()].copy_from_slice(four);
            }
        }
        for k in (0..n).rev() {
            let (before, own) = columns.split_at_mut(k * stride);
            let inverse = 1.0 / own[k / WIDTH].0[k % WIDTH];
            self.inverse[k] = inverse;
            let xk = x[k];
            for (i, column) in before.chunks_exact_mut(stride).enumerate() {
                let a = own[i / WIDTH].0[i % WIDTH] * inverse;
                x[i] -= a * xk;
                let a = L::splat(a);
                for (to, from) in column[..=i / WIDTH].iter_mut().zip(&*own) {
                    a.neg_mul_add(L::load(from), L::load(to)).store(to);
                }
            }
        }
        for k in 0..n {
            let xk = x[k] * self.inverse[k];
            x[k] = xk;
            for i in k + 1..n {
                x[i] -= columns[i * stride + k / WIDTH].0[k % WIDTH] * xk;
            }
        }
    }
}
