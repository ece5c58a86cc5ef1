//! `SIG_VALTYPE_`: the statement by which a signal is a float and no integer.

use super::statements::SignalText;
use problem::Problem;

/// The keyword of the statement.
pub(super) const KEYWORD: &str = "SIG_VALTYPE_";

/// Parts by which a range exceeds what an integer's bits can hold from which on it is a float's: real
/// files have ranges that are some powers of ten too wide, a float's ends at 3.4e38.
const FLOAT_RANGE: f64 = 1e6;

/// Ends of a range, in counts, below which a fraction is a choice: beyond them it may be the rounding of a unit.
const FRACTIONS: f64 = 1e4;

/// Refuses a range that only a float can have, of bits that are an integer's for want of a type; `path` is
/// `MESSAGE.signal`, `held` what the integer can be.
pub(super) fn range_of_float(signal: &SignalText, held: (f64, f64), path: &str) -> Option<Problem> {
    let written = signal.range;
    let reach = |(low, high): (f64, f64)| low.abs().max(high.abs());
    if !matches!(signal.size, 32 | 64) || reach(held) == 0.0 {
        return None;
    }
    let broken = |value: f64| value.fract() != 0.0;
    // Whole counts of one unit each have no fractions.
    let fractions = signal.factor == 1.0
        && !broken(signal.offset)
        && (broken(written.0) || broken(written.1))
        && reach(written) < FRACTIONS;
    let too_wide = reach(written) > FLOAT_RANGE * reach(held);
    let why = if too_wide {
        format!("holds at most [{:e}|{:e}]", held.0, held.1)
    } else if fractions {
        "holds whole numbers alone".to_owned()
    } else {
        return None;
    };
    let ends = if too_wide {
        format!("[{:e}|{:e}]", written.0, written.1)
    } else {
        format!("[{}|{}]", written.0, written.1)
    };
    let size = signal.size;
    let reason = format!(
        "signal {path} has range {ends}, but as an integer of {size} bits it {why}: its type is missing"
    );
    let number = if size == 32 { 1 } else { 2 };
    let (message, name) = path.split_once('.').unwrap_or((path, ""));
    let allowed = format!(
        "for a float, `{KEYWORD} ID {name} : {number};` with the id of {message}; for an integer, a range that it holds, or [0|0]"
    );
    Some(Problem::new(reason, allowed))
}
