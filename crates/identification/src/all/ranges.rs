//! Ranges of what a log covered.

use crate::record::Record;
use joint_file::ValidityTable;

/// Ranges that a training log covered: all but the outermost thousandth at either end.
pub(super) fn validity(record: &Record, moved_s: f64) -> ValidityTable {
    let tau = record.smooth(&record.tau, 0);
    let rate = record.smooth(&record.tau, 1);
    let range = |values: &mut dyn Iterator<Item = f64>| -> [f64; 2] {
        let mut sorted: Vec<f64> = values.filter(|x| x.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let outer = sorted.len() / 1000;
        let at = |i: usize| sorted.get(i).copied().unwrap_or(0.0);
        [at(outer), at(sorted.len().saturating_sub(1 + outer))]
    };
    let usable: Vec<usize> = record.spread(usize::MAX).collect();
    let of = |f: &dyn Fn(usize) -> f64| range(&mut usable.iter().map(|&i| f(i)));
    ValidityTable {
        torque: of(&|i| tau[i]),
        angle: of(&|i| record.samples[i].q),
        speed: of(&|i| record.motion[i][0].abs())[1],
        loading: of(&|i| rate[i].abs())[1],
        moved: moved_s,
    }
}
